"""Requests for fits in the window, and the stream of their steps; it runs on the worker."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.fitting.category_check import describe_category, describe_difference, likelier_model
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep
from core.fitting.settings import PaperSettings
from core.models.model import Model
from core.models.open_models import OpenModels
from viewer.services.backend import Backend
from viewer.values.fit_history import FitRequest, FittedPhoto

WINDOW_PRESETS = tuple(name for name, settings in PRESETS.items() if not isinstance(settings, PaperSettings))
"""Presets to choose from; the paper's own recipe is a baseline for the command line."""
_RESUMED_SHARE = 3  # A fit that is resumed has one of so many steps of the preset: there is no search


class Remark(str):
    """A line for the person who waits, about a photo that is fitted all the same."""


class ChosenModel(NamedTuple):
    """The model for a photo, by what that shows."""

    model: Model
    warning: str  # empty unless the photo does not seem to show an object of the model's category


@dataclass(eq=False)
class FitOptions:
    """How the next fit is made."""

    preset: str = "normal"
    estimate_focal: bool = False

    def settings(self, resumed: bool) -> FitSettings:
        """Of a fit from the beginning, or of one that is resumed."""
        settings = replace(PRESETS[self.preset], estimate_focal=self.estimate_focal)
        return replace(settings, steps=max(1, settings.steps // _RESUMED_SHARE)) if resumed else settings


def fit_stream(
    backend: Backend, models: OpenModels, here: Model, request: FitRequest, settings: FitSettings
) -> Iterator[ChosenModel | Remark | FittedPhoto | FitStep | None]:
    """The model, unless the request names one, the photos that have not been read, then the steps.

    Args:
        here: the model of the object on screen, taken where several models are as likely.
    """
    history, resume_from = request.history, request.resume_from
    model = models[history.model] if history.model else None
    photos, first = [fitted.photo for fitted in history.photos], dict[str, float]()
    for source in history.sources[len(photos) :]:
        cut = backend.cut_out(source.path, source.hints)
        guess = backend.guess_category(cut)
        if said := describe_difference(first, guess):
            yield Remark(f"{source.name}: {said}")
        first = first or guess
        if model is None:
            model = _choose(models, here, likelier_model(guess) if guess else here.category)
            yield ChosenModel(model, describe_category(guess, model.category))
        for _ in backend.view_bank(model):  # photos are cropped, and cameras ranked by it
            yield None
        photos.append(backend.frame_photo(cut, model, source))
        yield FittedPhoto.of(source, photos[-1])
    assert model is not None, "no photo"
    for _ in backend.view_bank(model):
        yield None
    past = history.steps[-1].seconds if history.steps else 0.0
    for step in backend.fit(model, FitJob(tuple(photos), settings, resume_from=resume_from)):
        yield replace(step, seconds=past + step.seconds)


def _choose(models: OpenModels, here: Model, category: str) -> Model:
    stays = here.category == category and not models.is_former(here)
    return here if stays else models.of_category(category) or here
