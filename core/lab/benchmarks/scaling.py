"""The value of training shapes: models trained the same way, with the same steps, on more and more shapes.

Each set of shapes holds the smaller ones, so only what is added makes a difference. Models and scores are kept, so that
a run resumes where one was stopped.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.machine import describe_machine
from core.lab.benchmarks.trained_models import Variant, score_variants, train_variants, trained_objects_views
from core.lab.datasets.srn import ObjectEntry, index_objects
from core.lab.evaluation.statistics import Mean, mean_gain, mean_of
from core.lab.training.recipes import RECIPES

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


def subsets(entries: Sequence[ObjectEntry]) -> tuple[tuple[ObjectEntry, ...], ...]:
    """The objects of every eighth shape, of every fourth, every second, and all."""
    shapes = list(dict.fromkeys(entry.shape_id for entry in entries))
    some = [frozenset(shapes[::stride]) for stride in STRIDES]
    return tuple(tuple(entry for entry in entries if entry.shape_id in chosen) for chosen in some)


def measure_scaling(
    folders: Sequence[Path], tests: Sequence[ObjectEntry], steps: int, kept: Path
) -> Iterator[str | Results[ScalingPoint]]:
    """Yields what is being done, and at the end the results; models and their scores are kept in ``kept``."""
    category, entries = index_objects(folders)
    chosen, settings = subsets(entries), replace(RECIPES["default"], steps=steps)
    variants = [Variant(f"{category}-shapes{_shapes(some)}", settings, some) for some in chosen]
    trained = yield from train_variants(folders, variants, kept)
    views = trained_objects_views(chosen[0], category, trained[0].model)
    scores = yield from score_variants(trained, views, tests)
    points = [
        ScalingPoint(
            _shapes(some),
            len(some),
            one.new_views,
            mean_of(one.held_out),
            mean_gain(one.held_out, scores[0].held_out),
            mean_of(one.found),
        )
        for some, one in zip(chosen, scores, strict=True)
    ]
    about = {"machine": describe_machine(trained[0].model.device), "category": category}
    yield Results(about | {"tests": str(len(tests)), "steps": str(steps)}, tuple(points))


def _shapes(entries: Sequence[ObjectEntry]) -> int:
    return len({entry.shape_id for entry in entries})
