"""Requests for fits in the window, and the stream of their steps; it runs on the worker."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep
from core.fitting.settings import PaperSettings
from core.models.model import Model
from viewer.services.backend import Backend
from viewer.values.fit_history import FitRequest, FittedPhoto

WINDOW_PRESETS = tuple(name for name, settings in PRESETS.items() if not isinstance(settings, PaperSettings))
"""Presets to choose from; the paper's own recipe is a baseline for the command line."""
_RESUMED_SHARE = 3
"""A fit that is resumed has one of so many steps of the preset: there is no search."""


class CategoryGuess(dict[str, float]):
    """How probable it is that a photo shows each category."""


@dataclass(eq=False)
class FitOptions:
    """How the next fit is made, whichever model is open."""

    preset: str = "normal"
    estimate_focal: bool = False

    def settings(self, resumed: bool) -> FitSettings:
        """Of a fit from the beginning, or of one that is resumed."""
        settings = replace(PRESETS[self.preset], estimate_focal=self.estimate_focal)
        return replace(settings, steps=max(1, settings.steps // _RESUMED_SHARE)) if resumed else settings


def fit_stream(
    backend: Backend, model: Model, request: FitRequest, settings: FitSettings
) -> Iterator[FittedPhoto | CategoryGuess | FitStep | None]:
    """The photos that have not been read and the category that each shows, then the steps."""
    history, resume_from = request.history, request.resume_from
    for _ in backend.view_bank(model):  # photos are cropped, and cameras ranked by it
        yield None
    photos = [fitted.photo for fitted in history.photos]
    for source in history.sources[len(photos) :]:
        photos.append(backend.load_photo(source.path, model, *source[1:]))
        yield FittedPhoto.of(source, photos[-1])
        yield CategoryGuess(backend.guess_category(photos[-1]))
    past = history.steps[-1].seconds if history.steps else 0.0
    for step in backend.fit(model, FitJob(tuple(photos), settings, resume_from=resume_from)):
        yield replace(step, seconds=past + step.seconds)
