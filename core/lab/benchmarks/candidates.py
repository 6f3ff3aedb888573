"""Candidates for a better model: each trained for the same time, then judged by fits of held-out objects.

Fits run in processes of their own while the next candidate trains, so that a graphics card is never idle. They are the
library's, with free biases, and are compared with those by the shipped model of the category.
"""

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core.fitting.fit import FitJob, FitSettings, fit
from core.lab.datasets.srn import Dataset, ObjectEntry
from core.lab.evaluation.protocol import ViewScore, as_photo, score_view
from core.lab.training.recipes import TrainSettings
from core.lab.training.trainer import Trainer, prepare_rays
from core.metrics import rotation_error
from core.models.field_config import FieldConfig
from core.models.library import load_model, shipped_models
from core.models.model import Model
from core.photos.view_bank import view_bank
from core.runtime.precision import require_device

SHIPPED = "shipped"
KEY = "candidate", "posed", "name", "view"  # of a judgement
_PHOTO_VIEWS = (1, 5, 9, 14, 18, 22)  # of the first object; every further object's are three views on
_NEXT_OBJECT = 3
_NOVEL_VIEWS = (3, 7, 11, 15, 19)  # how many views after the photo's are those that judge a fit
_WARM = 20  # steps that compile and warm up, excluded from the measured pace
_PACE_EVERY = 50  # steps between two estimates of the pace
_UNKNOWN_PACE = 1_000_000  # steps of a schedule until then: it has not left its beginning
_CODE_NOISE = 0.5, 0.1  # half of the codes' size made recombined chairs worth 0.8 dB
_CODE_BOUND = 12.0  # half of what most layers of the shipped cars have; those of the shipped chairs have 50 to 110
_REGULAR = (0.0, 0.5), (0.5, 0.5), (0.8, 0.0), (1.0, 0.0)
"""moments of a run, and the fraction of the rays for the dataset of regular objects"""


@dataclass(frozen=True)
class Judgement:
    """A fit of one view by one model, and the object's other views at the dataset's size."""

    candidate: str
    posed: bool  # fitted with the true camera
    name: str  # of the object
    view: int
    rotation: float  # degrees, error of the fitted camera
    photo: ViewScore  # the fitted view
    novel: ViewScore  # mean of some other views
    confidence: float | None  # None for a known camera
    seconds: float  # of the fit

    def __str__(self) -> str:
        camera = "known camera" if self.posed else f"{self.rotation:.0f} degrees off"
        return f"{self.candidate}: {self.name} {self.view}, {camera}, other views {self.novel.psnr:.1f} dB"


class Case(NamedTuple):
    """A view to fit."""

    entry: ObjectEntry
    view: int
    posed: bool


class Budget(NamedTuple):
    """The length of each candidate's training: a time, else a number of steps."""

    seconds: float | None  # after the first steps, which compile
    steps: int


def candidates(
    counts: Sequence[int], regular: int | None, rays: int, latent: tuple[int, int] = (64, 32)
) -> dict[str, TrainSettings]:
    """Return the settings of each candidate by name.

    Args:
        counts: numbers of objects of the datasets.
        regular: number of the dataset of regular objects, whose share changes in one candidate; None: omit that one.
        latent: numbers of a shape code and of a texture code.
    """
    field = FieldConfig(width=96, shape_latent=latent[0], texture_latent=latent[1])
    narrow = TrainSettings(field=field, rays=rays, code_noise=_CODE_NOISE)
    wide = replace(narrow, field=replace(field, width=128))
    chosen = {"narrow": narrow, "wide": wide, "bounded": replace(wide, code_bound=_CODE_BOUND)}
    if regular is None or len(counts) < 2:
        return chosen
    return chosen | {"regular": replace(wide, shares=_regular_shares(counts, regular))}


def _regular_shares(counts: Sequence[int], regular: int) -> tuple[tuple[float, tuple[float, ...]], ...]:
    """Return changing shares of the regular dataset; the rest goes to the other objects alike."""
    rest = sum(counts) - counts[regular]
    return tuple(
        (moment, tuple(fraction if i == regular else (1 - fraction) * count / rest for i, count in enumerate(counts)))
        for moment, fraction in _REGULAR
    )


def judged_cases(entries: Sequence[ObjectEntry], views_each: int = len(_PHOTO_VIEWS)) -> list[Case]:
    """Return the views to fit, each with and without its camera: the first view of all objects, then the second."""
    cases = []
    for view in _PHOTO_VIEWS[:views_each]:
        for number, entry in enumerate(entries):
            cases += [Case(entry, view + _NEXT_OBJECT * number, posed) for posed in (True, False)]
    return cases


def measure_candidates(
    dataset: Dataset,
    cases: Sequence[Case],
    chosen: Mapping[str, TrainSettings],
    budget: Budget,
    fit_settings: FitSettings,
    *,
    out: Path,
    device: str,
    pool: Executor,
    report: Callable[[str], object],
    done: Collection[tuple[str, bool, str, int]] = (),
) -> Iterator[Judgement]:
    """Train each candidate and yield each judgement as it is finished, also during training.

    A candidate is saved in the folder ``out`` as soon as it is trained, and not trained again by a later run. Raises
    ``ValueError`` at the end if a candidate diverged or a fit failed.

    Args:
        pool: runs the fits.
        report: gets a line when a candidate is trained.
        done: keys of judgements of an earlier run.
    """
    judge = _Judge(pool, cases, fit_settings, done)
    if dataset.category in shipped_models():
        judge.add(SHIPPED, dataset.category)
    missing = [name for name in chosen if not (out / f"{name}.safetensors").exists()]
    rays = prepare_rays(dataset, require_device(device)) if missing else None
    for name, settings in chosen.items():
        path = out / f"{name}.safetensors"
        if name not in missing:
            judge.add(name, str(path))
            continue
        assert rays
        trainer = Trainer(dataset, replace(settings, steps=budget.steps), device, prepared=rays.with_own_hulls())
        yield from _train(trainer, budget, judge, name, path)
        report(f"{name}: {trainer.step} steps in {trainer.seconds:.0f} s")
    yield from judge.rest()
    if judge.failures:
        raise ValueError("; ".join(judge.failures))


def _train(trainer: Trainer, budget: Budget, judge: "_Judge", name: str, path: Path) -> Iterator[Judgement]:
    """Train a candidate and hand it to the judge; yield the judgements of earlier ones that are finished meanwhile."""
    try:
        for _ in _timed(trainer, budget):
            yield from judge.finished()
    except ValueError as error:  # the other candidates go on
        judge.failures.append(f"{name}: {error}")
        return
    judge.complete(name, trainer.model(), path)


def _timed(trainer: Trainer, budget: Budget) -> Iterator[None]:
    """Train to the end of the budget. The schedule's length follows from the pace so far."""
    if budget.seconds is None:
        for _ in trainer.steps():
            yield
        return
    trainer.reschedule(_UNKNOWN_PACE)
    began = 0.0
    for step in trainer.steps():
        if step.step == _WARM:
            began = step.seconds
        if step.step > _WARM and (step.step - _WARM) % _PACE_EVERY == 0:
            spent = step.seconds - began
            pace = spent / (step.step - _WARM)
            trainer.reschedule(step.step + max(0, round((budget.seconds - spent) / pace)))
        yield


class _Judge:
    """Judges models in a pool while others train."""

    def __init__(
        self,
        pool: Executor,
        cases: Sequence[Case],
        settings: FitSettings,
        done: Collection[tuple[str, bool, str, int]],
    ) -> None:
        self.pool = pool
        self.cases = cases
        self.settings = settings
        self.done = done
        self._completing: dict[Future[str], str] = {}  # names of the candidates that are being saved
        self._fits: dict[Future[Judgement], str] = {}  # names of the candidates that are judged
        self.failures: list[str] = []

    def complete(self, name: str, model: Model, path: Path) -> None:
        """Add a trained candidate that still has to be saved with all that fits need."""
        self._completing[self.pool.submit(_save_complete, model, path)] = name

    def add(self, name: str, model: str) -> None:
        """Add a model by its name or path."""
        for case in self.cases:
            if (name, case.posed, case.entry.name, case.view) not in self.done:
                self._fits[self.pool.submit(_judge, name, model, case, self.settings)] = name

    def finished(self) -> Iterator[Judgement]:
        """Yield the judgements that have been finished since the last call."""
        yield from self._collect(0.0)

    def rest(self) -> Iterator[Judgement]:
        """Wait for all judgements, yielding each."""
        while self._completing or self._fits:
            yield from self._collect(None)

    def _collect(self, timeout: float | None) -> Iterator[Judgement]:
        running: list[Future[Any]] = [*self._completing, *self._fits]
        finished, _ = wait(running, timeout, FIRST_COMPLETED)
        for future in finished:
            completed = self._completing.pop(future, None)
            name = completed or self._fits.pop(future)
            if error := future.exception():
                self.failures.append(f"{name}: {error}")
            elif completed:
                self.add(name, future.result())
            else:
                yield future.result()


def _save_complete(model: Model, path: Path) -> str:
    """Save a model with a view bank and the viewpoint classifier of the category's shipped model; return the path."""
    if model.category in shipped_models():
        model = replace(model, viewpoint_classifier=load_model(model.category).viewpoint_classifier)
    model.save(path)  # before anything can fail
    replace(model, view_bank=view_bank(model), stored_cells=model.occupied_cells).save(path)
    return str(path)


@lru_cache(maxsize=1)
def _load(model: str) -> Model:
    return load_model(model)


def _judge(candidate: str, model_name: str, case: Case, settings: FitSettings) -> Judgement:
    """Fit a view at the model's image size, and compare renders with the object's views at the dataset's size."""
    model = _load(model_name)
    views = case.entry.read()
    count = len(views.cameras)
    index = case.view % count
    photo = as_photo(views.reduced(model.image_size), index, case.posed)
    began = time.perf_counter()
    *_, last = fit(model, FitJob((photo,), settings))
    seconds = time.perf_counter() - began
    instance = last.instance.with_detail(None)
    scores = [score_view(instance, views, (index + offset) % count) for offset in _NOVEL_VIEWS]
    return Judgement(
        candidate,
        case.posed,
        case.entry.name,
        case.view,
        rotation=rotation_error(last.cameras[0], views.cameras[index]),
        photo=score_view(instance, views, index),
        novel=ViewScore(*np.mean(scores, axis=0).tolist()),
        confidence=last.confidence,
        seconds=seconds,
    )
