"""Models that a benchmark trains to compare them: each is trained and scored once, and kept with its scores.

A benchmark lists its :class:`Variant` objects; a run that was stopped resumes with the first that is not kept yet.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import torch

from core.fitting.confidence import RIGHT_DEGREES
from core.fitting.fit import PRESETS
from core.lab.benchmarks.fits import FitMethod, FitTrial, fit_view
from core.lab.benchmarks.held_out_views import dataset_views
from core.lab.datasets.srn import Dataset, ObjectEntry, read_dataset
from core.lab.evaluation.protocol import EvaluationProtocol, evaluate
from core.lab.training.recipes import TrainSettings
from core.lab.training.trainer import Trainer, held_out_psnr, hold_out
from core.models.model import Model
from core.runtime.files import write_json
from core.runtime.reading import read_json, reading, typed

_NEW_VIEWS = 8  # training objects of which a view that was not trained on is rendered
_VIEW_STRIDE = 5  # over the other views of a test object


class Variant(NamedTuple):
    """A model to train, and the objects to train it on."""

    name: str  # of its file, without the number of steps
    settings: TrainSettings
    entries: Sequence[ObjectEntry]


@dataclass(frozen=True)
class Scores:
    """How good a model is."""

    model: str  # its fingerprint
    tests: tuple[str, ...]  # names of the test objects
    new_views: float  # dB, views not trained on of training objects
    held_out: tuple[float, ...]  # dB, of each test object: other views, fitted on one view from its true camera
    found: tuple[float, ...]  # 1 where its camera was found within 10 degrees from a random view, else 0
    fit_seconds: tuple[float, ...]  # of these blind fits


class TrainedModel(NamedTuple):
    """A variant that is trained and kept."""

    path: Path
    model: Model

    @property
    def parameters(self) -> int:
        """How many the network has."""
        return sum(parameter.numel() for parameter in self.model.field.parameters())


def train_variants(
    folders: Sequence[Path], variants: Sequence[Variant], kept: Path
) -> Generator[str, None, list[TrainedModel]]:
    """Trains those variants that are not in ``kept``; yields what is being done.

    Args:
        folders: of the dataset, which is read as a whole only where a model is missing.

    Raises ``ValueError`` where a kept model was trained on other objects than its variant.
    """
    whole = cache(lambda: hold_out(read_dataset(list(folders)))[0])
    found = []
    for name, settings, entries in variants:
        path = kept / f"{name}-{settings.steps}.safetensors"
        if not path.exists() or Model.load(path).field.config != settings.field:
            yield from _train(whole(), settings, entries, path)
        found.append(TrainedModel(path, _load(path, entries)))
    return found


def _train(dataset: Dataset, settings: TrainSettings, entries: Sequence[ObjectEntry], path: Path) -> Iterator[str]:
    names = {entry.name for entry in entries}
    part = replace(dataset, objects=tuple(views for views in dataset.objects if views.name in names))
    trainer = Trainer(part, settings)
    for step in trainer.steps():
        if step.step % 100 == 0:
            yield f"training, {path.stem}, step {step.step} of {settings.steps}, {step.psnr:.1f} dB"
    trainer.model().save(path)


def _load(path: Path, entries: Sequence[ObjectEntry]) -> Model:
    model = Model.load(path)
    if {entry.name for entry in model.codes.objects} != {entry.name for entry in entries}:
        raise ValueError(f"{path} was trained on other objects; keep models of these in another folder")
    return model


def trained_objects_views(entries: Sequence[ObjectEntry], category: str, model: Model) -> Dataset:
    """Of some training objects, evenly over ``entries``, the view that no model was trained on."""
    some = tuple(entry.read() for entry in entries[:: max(1, len(entries) // _NEW_VIEWS)][:_NEW_VIEWS])
    return hold_out(Dataset(some, category, model.image_size, model.focal), _NEW_VIEWS)[1]


def score_variants(
    trained: Sequence[TrainedModel], views: Dataset, tests: Sequence[ObjectEntry]
) -> Generator[str, None, list[Scores]]:
    """Scores models, each unless its scores for these tests are kept beside it; yields what is being done.

    Args:
        views: of objects that all were trained on, as :func:`trained_objects_views` has them.
        tests: objects that none was trained on.
    """
    found = []
    for path, model in trained:
        kept = path.with_suffix(".json")
        scores = _read_scores(kept) if kept.exists() else None
        if not scores or (scores.model, scores.tests) != (model.fingerprint, tuple(entry.name for entry in tests)):
            scores = yield from _score(model, path.stem, views, tests)
            write_json(kept, asdict(scores))
        found.append(scores)
    return found


def _read_scores(path: Path) -> Scores:
    with reading(path, "a file of scores"):
        return typed(Scores, read_json(path), name="scores")


def _score(model: Model, name: str, views: Dataset, tests: Sequence[ObjectEntry]) -> Generator[str, None, Scores]:
    yield f"new views of training objects, {name}"
    new_views = held_out_psnr(model, views)
    psnrs, trials = list[float](), list[FitTrial]()
    for number, entry in enumerate(tests):
        yield f"fits, {name}, {entry.name}"
        test, paper = entry.read(), EvaluationProtocol(every=_VIEW_STRIDE)
        known = paper if len(test.cameras) > max(paper.inputs) else replace(paper, inputs=(0,))
        psnrs += [score.psnr for score in evaluate(model, [test], known)]
        (target,) = dataset_views(model, [entry], torch.Generator().manual_seed(number))
        trials.append(fit_view(model, target, "normal", FitMethod(PRESETS["normal"]), number))
    found = tuple(float(trial.effective_rotation <= RIGHT_DEGREES) for trial in trials)
    names, seconds = tuple(entry.name for entry in tests), tuple(trial.seconds for trial in trials)
    return Scores(model.fingerprint, names, new_views, tuple(psnrs), found, seconds)
