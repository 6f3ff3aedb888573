"""What training shapes buy: models trained the same way, with the same steps, on more and more shapes.

Each set of shapes holds the smaller ones, so only what is added makes a difference. Models and scores are kept, so that
a run resumes where one was stopped.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from core.benchmarks.machine import describe_machine
from core.benchmarks.trained_models import Scores, load_trained, score_model, train_model, trained_objects_views
from core.datasets.srn import Dataset, ObjectEntry, index_objects, read_dataset
from core.evaluation.statistics import Mean, mean_of
from core.models.model import Model
from core.training.recipes import RECIPES
from core.training.trainer import hold_out

STRIDES = (8, 4, 2, 1)
"""Every so many shapes are trained on; each divides the one before."""


@dataclass(frozen=True)
class ScalingPoint:
    """One model."""

    shapes: int
    """trained on"""
    objects: int
    """the same, in all their textures"""
    new_views: float
    """dB, views not trained on of objects that all models know"""
    held_out: Mean
    """dB, other views of objects never trained on, fitted on one view from its true camera"""
    gain: Mean
    """dB, of the same objects over the model with the fewest shapes"""
    found: Mean
    """share of the same objects' cameras found within 10 degrees, from a random view"""


@dataclass(frozen=True)
class ScalingResults:
    """All models of one run."""

    machine: str
    category: str
    tests: int
    """objects held out"""
    steps: int
    """of training, for each model"""
    points: tuple[ScalingPoint, ...]


def subsets(entries: Sequence[ObjectEntry]) -> tuple[tuple[ObjectEntry, ...], ...]:
    """The objects of every eighth shape, of every fourth, every second, and all."""
    shapes = list(dict.fromkeys(entry.shape_id for entry in entries))
    some = [frozenset(shapes[::stride]) for stride in STRIDES]
    return tuple(tuple(entry for entry in entries if entry.shape_id in chosen) for chosen in some)


def run(
    folders: Sequence[Path], tests: Sequence[ObjectEntry], steps: int, kept: Path
) -> Iterator[str | ScalingResults]:
    """Yields what is being done, and at the end the results.

    Args:
        folders: of the dataset to train on, which is read as a whole only where a model is missing.
        kept: where models and their scores are kept; what is there already is not done again.
    """
    category, entries = index_objects(folders)
    whole = cache(lambda: hold_out(read_dataset(list(folders)))[0])
    chosen, models = subsets(entries), list[Model]()
    paths = [kept / f"{category}-shapes{_shapes(some)}-{steps}.safetensors" for some in chosen]
    for some, path in zip(chosen, paths, strict=True):
        if not path.exists():
            yield from train_model(_part(whole(), some), replace(RECIPES["default"], steps=steps), path)
        models.append(load_trained(path, some))
    whole.cache_clear()
    views, scores = trained_objects_views(chosen[0], category, models[0]), list[Scores]()
    for path, model in zip(paths, models, strict=True):
        scores.append((yield from score_model(model, views, tests, path.with_suffix(".json"))))
    points = [_point(some, one, scores[0]) for some, one in zip(chosen, scores, strict=True)]
    yield ScalingResults(describe_machine(models[0].device), category, len(tests), steps, tuple(points))


def _shapes(entries: Sequence[ObjectEntry]) -> int:
    return len({entry.shape_id for entry in entries})


def _part(dataset: Dataset, entries: Sequence[ObjectEntry]) -> Dataset:
    names = {entry.name for entry in entries}
    return replace(dataset, objects=tuple(views for views in dataset.objects if views.name in names))


def _point(entries: Sequence[ObjectEntry], scores: Scores, first: Scores) -> ScalingPoint:
    gains = [psnr - other for psnr, other in zip(scores.held_out, first.held_out, strict=True)]
    found = mean_of(scores.found)
    return ScalingPoint(
        _shapes(entries), len(entries), scores.new_views, mean_of(scores.held_out), mean_of(gains), found
    )
