"""The options of a fit, and the stream of its photos and steps for the worker."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.fitting.category_check import describe_category, describe_difference, likeliest_model
from core.fitting.fit import FitJob, FitSettings, FitStep
from core.models.model import Model
from core.models.open_models import OpenModels
from core.photos.decode import read_rgba
from core.photos.plain_background import NoBackgroundError
from core.photos.segmentation import CutOut
from viewer.services.backend import Backend
from viewer.services.jobs import Jobs
from viewer.values.fit_history import FitRequest, FittedPhoto, PhotoSource
from viewer.values.seen_cut_out import SeenCutOut, has_rival, is_doubtful, pixels_on_white

_RESUMED_SHARE = 3  # divisor of a resumed fit's steps, as it needs no search


class Doubt(NamedTuple):
    """A question about the next photo, which ends the stream until a person answers."""

    words: str
    model: Model  # model that would fit the photo
    cut: CutOut | None  # None if no object was found
    seen: SeenCutOut


@dataclass(eq=False)
class FitOptions:
    """Options of the next fit."""

    estimate_focal: bool = False

    def settings(self, resumed: bool) -> FitSettings:
        """Return the settings of a new fit, or of a resumed one."""
        settings = FitSettings(estimate_focal=self.estimate_focal)
        return replace(settings, steps=max(1, settings.steps // _RESUMED_SHARE)) if resumed else settings


def fit_stream(
    jobs: Jobs, here: Model, request: FitRequest, settings: FitSettings, known: Mapping[PhotoSource, CutOut]
) -> Iterator[Model | Doubt | SeenCutOut | FittedPhoto | FitStep | None]:
    """Yield each new photo's cut-out and photo, the model unless the request names one, then the steps.

    A :class:`Doubt` ends the stream. None only marks progress.

    Args:
        here: the model on screen, taken if the photo's category is unknown.
        known: cut-outs that a person has confirmed, by source.
    """
    backend, models, history = jobs.backend, jobs.models, request.history
    model = models[history.model] if history.model else None
    photos = [fitted.photo for fitted in history.photos]
    first = photos[0].categories if photos else {}
    for source in history.sources[len(photos) :]:
        try:
            cut = known.get(source) or backend.cut_out(source.path, source.hints)
        except NoBackgroundError:
            bare = SeenCutOut(pixels_on_white(read_rgba(source.path)), ())
            yield Doubt("The object was not found: point at it", model or here, None, bare)
            return
        guess = _guess(backend, cut)
        seen, chosen = SeenCutOut.of(read_rgba(source.path), cut), model or _choose(models, here, guess)
        asked = len(photos) < request.answered or source.hints is not None
        about = describe_difference(first, guess) if model else describe_category(guess, chosen.category)
        if not asked and (words := _doubt(cut, about)):
            yield Doubt(words, chosen, cut, seen)
            return
        first = first or guess
        yield seen
        if model is None:
            model = chosen
            yield model
        bank = yield from jobs.banks.wait(model)  # crops photos and ranks cameras
        photos.append(backend.frame_photo(cut, model, bank, source))
        yield FittedPhoto.of(source, photos[-1], seen)
    assert model is not None, "no photo"
    job = FitJob(tuple(photos), (yield from jobs.banks.wait(model)), settings, resume_from=request.resume_from)
    past = history.steps[-1].seconds if history.steps else 0.0
    for step in backend.fit(model, job):
        yield replace(step, seconds=past + step.seconds)


def _guess(backend: Backend, cut: CutOut) -> dict[str, float]:
    """Return the probability of each category; with a doubtful mask, by the detection alone."""
    if is_doubtful(cut):
        return cut.detections[0].probabilities if cut.detections else {}
    return backend.guess_category(cut)


def _doubt(cut: CutOut, about_category: str) -> str:
    """Return the question about a cut-out; "" if it can be fitted at once."""
    if has_rival(cut):
        return "Which one? Click on it"
    if is_doubtful(cut):
        return "Is the whole object outlined, and nothing else?"
    return f"{about_category[:1].upper()}{about_category[1:]}"


def _choose(models: OpenModels, here: Model, guess: Mapping[str, float]) -> Model:
    category = likeliest_model(guess) if guess else here.category
    stays = here.category == category and not models.is_former(here)
    return here if stays else models.of_category(category) or here
