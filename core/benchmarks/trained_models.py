"""Models that a benchmark trains and scores: each is trained once, and its scores are kept beside it."""

import json
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

from core.benchmarks.fits import Trial, fit_view
from core.benchmarks.held_out_views import dataset_views
from core.datasets.srn import Dataset, ObjectEntry
from core.evaluation.protocol import Protocol, evaluate
from core.files import write_json
from core.fitting.confidence import RIGHT_DEGREES
from core.fitting.fit import PRESETS
from core.models.model import Model
from core.photos.view_bank import build_view_bank
from core.training.recipes import TrainSettings
from core.training.trainer import Trainer, held_out_psnr, hold_out

_NEW_VIEWS = 8
"""training objects of which a view that was not trained on is rendered"""
_VIEW_STRIDE = 5
"""over the other views of a test object"""


@dataclass(frozen=True)
class Scores:
    """How good a model is."""

    model: str
    """its fingerprint"""
    tests: list[str]
    """names of the test objects"""
    new_views: float
    """dB, views not trained on of training objects"""
    held_out: list[float]
    """dB, of each test object: other views, fitted on one view from its true camera"""
    found: list[float]
    """1 where its camera was found within 10 degrees from a random view, else 0"""
    fit_seconds: list[float]
    """of these blind fits"""


def train_model(dataset: Dataset, settings: TrainSettings, path: Path) -> Iterator[str]:
    """Trains a model and saves it; yields what is being done."""
    trainer = Trainer(dataset, settings)
    for step in trainer.steps():
        if step.step % 100 == 0:
            yield f"training, {path.stem}, step {step.step} of {settings.steps}, {step.psnr:.1f} dB"
    trainer.model().save(path)


def load_trained(path: Path, entries: Sequence[ObjectEntry]) -> Model:
    """A model that was kept. Raises ``ValueError`` where it was trained on other objects than these."""
    model = Model.load(path)
    if {entry.name for entry in model.codes.objects} != {entry.name for entry in entries}:
        raise ValueError(f"{path} was trained on other objects; keep models of these in another folder")
    return model


def trained_objects_views(entries: Sequence[ObjectEntry], category: str, model: Model) -> Dataset:
    """Of some training objects, evenly over ``entries``, the view that no model was trained on."""
    some = tuple(entry.read() for entry in entries[:: max(1, len(entries) // _NEW_VIEWS)][:_NEW_VIEWS])
    return hold_out(Dataset(some, category, model.image_size, model.focal), _NEW_VIEWS)[1]


def held_out_psnrs(model: Model, tests: Sequence[ObjectEntry]) -> list[float]:
    """dB of other views of each object, fitted on one view from its true camera: the paper's, if there are so many."""
    psnrs = []
    for _ in build_view_bank(model):
        pass
    for entry in tests:
        views, paper = entry.read(), Protocol(every=_VIEW_STRIDE)
        known = paper if len(views.cameras) > max(paper.inputs) else replace(paper, inputs=(0,))
        psnrs += [score.psnr for score in evaluate(model, [views], known)]
    return psnrs


def score_model(model: Model, views: Dataset, tests: Sequence[ObjectEntry], path: Path) -> Generator[str, None, Scores]:
    """Yields what is being done; returns the model's scores, from ``path`` where they are known.

    Args:
        views: of training objects, as :func:`trained_objects_views` has them.
        tests: objects that it was not trained on.
    """
    names = [entry.name for entry in tests]
    if path.exists():
        kept = json.loads(path.read_text())
        kept["new_views"] = kept.pop("own", kept.get("new_views"))  # the key of earlier versions
        if (kept["model"], kept["tests"]) == (model.fingerprint, names):
            return Scores(**kept)
    yield f"new views of training objects, {path.stem}"
    new_views = held_out_psnr(model, views)
    psnrs, trials = list[float](), list[Trial]()
    for number, entry in enumerate(tests):
        yield f"fits, {path.stem}, {entry.name}"
        psnrs += held_out_psnrs(model, [entry])
        (target,) = dataset_views(model, [entry], torch.Generator().manual_seed(number))
        trials.append(fit_view(model, target, "normal", PRESETS["normal"], number))
    found = [float(trial.effective_rotation <= RIGHT_DEGREES) for trial in trials]
    scores = Scores(model.fingerprint, names, new_views, psnrs, found, [trial.seconds for trial in trials])
    write_json(path, asdict(scores))
    return scores
