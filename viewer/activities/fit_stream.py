"""The options of a fit, and the stream of its photos and steps for the worker."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from core.fitting.category_check import (
    describe_category,
    describe_difference,
    is_sure,
    likeliest_category,
    likeliest_model,
)
from core.fitting.fit import FitJob, FitSettings, FitStep
from core.models.model import Model
from core.models.open_models import OpenModels
from core.photos.decode import read_rgba
from core.photos.plain_background import NoBackgroundError
from core.photos.segmentation import CutOut
from viewer.services.backend import Backend
from viewer.services.jobs import Jobs
from viewer.values.cut_out_preview import CutOutPreview, has_rival, is_doubtful, pixels_on_white
from viewer.values.fit_history import FitRequest, FittedPhoto, PhotoSource, Question

Confirmed = Mapping[PhotoSource, Callable[[], tuple[CutOut, CutOutPreview]]]
"""Cut-outs that a person has confirmed; their photos are not read again."""
FitValue = Model | Question | CutOutPreview | FittedPhoto | FitStep  # what a fit yields
_RESUMED_SHARE = 3  # divisor of a resumed fit's steps, as it needs no search


@dataclass(eq=False)
class FitOptions:
    """Options of the next fit."""

    estimate_focal: bool = False

    def settings(self, resumed: bool) -> FitSettings:
        """Return the settings of a new fit, or of a resumed one."""
        settings = FitSettings(estimate_focal=self.estimate_focal)
        return replace(settings, steps=max(1, settings.steps // _RESUMED_SHARE)) if resumed else settings


def fit_stream(
    jobs: Jobs, here: Model, request: FitRequest, settings: FitSettings, confirmed: Confirmed
) -> Iterator[FitValue | None]:
    """Yield each new photo's cut-out and photo, the model unless the request names one, then the steps.

    A :class:`Question` about the next photo ends the stream; None marks progress. ``here``, the model on screen, is for
    unknown categories.
    """
    backend = jobs.backend
    history = request.history
    model = jobs.models[history.model] if history.model else None
    photos = [fitted.photo for fitted in history.photos]
    first = photos[0].categories if photos else {}
    for source in history.sources[len(photos) :]:
        try:
            cut, preview = confirmed.get(source, partial(_cut_out, backend, source))()
        except NoBackgroundError:
            preview = CutOutPreview(pixels_on_white(read_rgba(source.file)), ())
            words = "The object was not found: point at it"
            yield Question(request, words, None, preview, (model or here).fingerprint)
            return
        guess = _guess(backend, cut)
        selected = model or _choose(jobs.models, here, guess)
        if len(photos) >= request.answered:
            warning = describe_difference(first, guess) if model else describe_category(guess, selected.category)
            categories = "" if model or is_sure(guess) else _categories(jobs.models)
            neither = source.hints is None and bool(guess) and likeliest_category(guess) is None
            if words := _doubt(source, cut, warning, categories, neither):
                fingerprint = "" if categories else selected.fingerprint
                yield Question(request, words, cut, preview, fingerprint, neither)
                return
        first = first or guess
        yield preview
        if model is None:
            model = selected
            yield model
        for _ in backend.view_bank(model):
            yield None
        photos.append(backend.frame_photo(cut, model, source))
        yield FittedPhoto(source, photos[-1], preview)
    assert model is not None, "no photo"
    job = FitJob(tuple(photos), settings, resume_from=request.resume_from)
    past = history.last.seconds if history.last else 0.0
    yield from (replace(step, seconds=past + step.seconds) for step in backend.fit(model, job))


def _guess(backend: Backend, cut: CutOut) -> dict[str, float]:
    """Return the probability of each category; with a doubtful mask, by the detection alone."""
    if is_doubtful(cut):
        return cut.detections[0].probabilities if cut.detections else {}
    return backend.guess_category(cut)


def _cut_out(backend: Backend, source: PhotoSource) -> tuple[CutOut, CutOutPreview]:
    cut = backend.cut_out(source.file, source.hints)
    return cut, CutOutPreview.of(read_rgba(source.file), cut)


def _doubt(source: PhotoSource, cut: CutOut, warning: str, categories: str, neither: bool) -> str:
    """Return the question about a cut-out; "" if it can be fitted at once.

    Args:
        warning: the warning about the category; may be empty.
        categories: the categories to choose from, if the photo's is in doubt.
        neither: the photo looks like none of them.
    """
    pointed_out = source.hints is not None
    if has_rival(cut) and not pointed_out:
        return "Which one? Click on it"
    if neither and categories:
        return f"Nothing here looks like {categories}"
    if categories and (pointed_out or is_doubtful(cut)):
        return f"Is it {categories}?"
    if pointed_out:
        return ""
    if is_doubtful(cut):
        return "Is the whole object outlined, and nothing else?"
    return f"{warning[:1].upper()}{warning[1:]}"


def _categories(models: OpenModels) -> str:
    """Return the categories of the models in words, "a chair or a car"; "" for a single one."""
    nouns = dict.fromkeys(f"a {model.noun}" for model in models if model.noun)
    return " or ".join(nouns) if len(nouns) > 1 else ""


def _choose(models: OpenModels, here: Model, guess: Mapping[str, float]) -> Model:
    category = likeliest_model(guess) if guess else here.category
    return here if here.category == category else models.of_category(category) or here
