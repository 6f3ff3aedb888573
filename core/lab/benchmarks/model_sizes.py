"""Quality against speed by size of the network and the codes: models trained the same way, each differing in one
number.

From a baseline one axis is swept at a time; last comes the size of the default recipe. All are trained on the same
objects with the same steps and the same random rays. The scores of each model are kept beside it, so that a run resumes
where one was stopped. Speed is measured at the end, with all models taking turns.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import torch

from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.machine import describe_machine
from core.lab.benchmarks.trained_models import Variant, score_variants, train_variants, trained_objects_views
from core.lab.datasets.srn import ObjectEntry, index_objects
from core.lab.evaluation.statistics import Mean, mean_gain, mean_of
from core.lab.training.recipes import RECIPES
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.runtime.precision import autocast

BASELINE = FieldConfig(width=128, shape_blocks=2, shape_latent=64, texture_latent=32, position_frequencies=10)
SWEEP = {
    "width": (32, 64, 96, 256),
    "shape_latent": (8, 16, 32, 128),
    "texture_latent": (8, 16, 64),
    "shape_blocks": (1, 3),
    "position_frequencies": (4, 6, 8),
}
_ROUNDS = 7
_POINTS = 100_000


@dataclass(frozen=True)
class ModelSize:
    """One model."""

    axis: str  # in which it differs from the baseline; or "baseline", or "default" for the size of the default recipe
    value: int  # there; 0 for these two
    parameters: int  # of the network
    bytes: int  # of the model file, codes included
    new_views: float  # dB, views not trained on of training objects
    held_out: Mean  # dB, other views of objects never trained on, fitted on one view from its true camera
    gain: Mean  # dB, of the same objects over the first model's
    found: Mean  # share of the same objects' cameras found within 10 degrees, from a random view
    fit_seconds: float  # median of these blind fits
    field_ms: float
    """to evaluate density and colour at 100,000 points: what a frame costs depends besides on how clean the object is,
    and after so little training all of them are hazy"""


def sweep() -> tuple[tuple[str, int, FieldConfig], ...]:
    """The baseline, then every other value of each axis, then the default recipe: (axis, value, configuration)."""

    def varied(**change: Any) -> FieldConfig:
        return replace(BASELINE, **change)

    others = [(axis, value, varied(**{axis: value})) for axis, values in SWEEP.items() for value in values]
    return (("baseline", 0, BASELINE), *others, ("default", 0, RECIPES["default"].field))


def measure_model_sizes(
    folders: Sequence[Path], tests: Sequence[ObjectEntry], steps: int, kept: Path
) -> Iterator[str | Results[ModelSize]]:
    """Yields what is being done, and at the end the results; models and their scores are kept in ``kept``."""
    category, entries = index_objects(folders)
    chosen, recipe = sweep(), RECIPES["default"]
    trained = yield from train_variants(
        folders,
        [
            Variant(f"{category}-{axis}{value}", replace(recipe, field=config, steps=steps), entries)
            for axis, value, config in chosen
        ],
        kept,
    )
    views = trained_objects_views(entries, category, trained[0].model)
    scores = yield from score_variants(trained, views, tests)
    yield "speed"
    times = _field_ms([one.model for one in trained])
    sizes = [
        ModelSize(
            *size[:2],
            parameters=one.parameters,
            bytes=one.path.stat().st_size,
            new_views=score.new_views,
            held_out=mean_of(score.held_out),
            gain=mean_gain(score.held_out, scores[0].held_out),
            found=mean_of(score.found),
            fit_seconds=median(score.fit_seconds),
            field_ms=ms,
        )
        for size, one, score, ms in zip(chosen, trained, scores, times, strict=True)
    ]
    about = {"machine": describe_machine(trained[0].model.device), "objects": str(len(entries))}
    yield Results(about | {"tests": str(len(tests)), "steps": str(steps)}, tuple(sizes))


@torch.no_grad()
def _field_ms(models: Sequence[Model]) -> list[float]:
    """Median of every model, over rounds in which all take turns."""
    generator = torch.Generator().manual_seed(0)
    points, directions = (2 * torch.rand(_POINTS, 3, generator=generator) - 1 for _ in range(2))
    times: list[list[float]] = [[] for _ in models]
    for turn in range(_ROUNDS + 1):
        for model, taken in zip(models, times, strict=True):
            codes, at = model.codes[0], model.device
            biases = model.field.biases(codes.shape, codes.texture)
            began = time.perf_counter()
            with autocast(at):
                towards = model.field.direction_bias(directions.to(at))
                model.field.radiance(points.to(at), towards, *biases)[1].cpu()
            if turn:
                taken.append(1000 * (time.perf_counter() - began))
    return [median(taken) for taken in times]
