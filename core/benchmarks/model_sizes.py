"""Quality against speed by size of the network and the codes: models trained the same way, each differing in one
number.

From a baseline one axis is swept at a time; last comes the size of the default recipe. All are trained on the same
objects with the same steps and the same random rays. The scores of each model are kept beside it, so that a run resumes
where one was stopped. Speed is measured at the end, with all models taking turns.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import torch

from core.benchmarks.machine import describe_machine
from core.benchmarks.trained_models import Scores, load_trained, score_model, train_model, trained_objects_views
from core.datasets.srn import ObjectEntry, index_objects, read_dataset
from core.evaluation.statistics import Mean, mean_of
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.models.precision import autocast
from core.training.recipes import RECIPES
from core.training.trainer import hold_out

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

    axis: str
    """in which it differs from the baseline; or "baseline", or "default" for the size of the default recipe"""
    value: int
    """there; 0 for these two"""
    parameters: int
    """of the network"""
    bytes: int
    """of the model file, codes included"""
    new_views: float
    """dB, views not trained on of training objects"""
    held_out: Mean
    """dB, other views of objects never trained on, fitted on one view from its true camera"""
    gain: Mean
    """dB, of the same objects over the first model's"""
    found: Mean
    """share of the same objects' cameras found within 10 degrees, from a random view"""
    fit_seconds: float
    """median of these blind fits"""
    field_ms: float
    """to evaluate density and colour at 100,000 points: what a frame costs depends besides on how clean the object is,
    and after so little training all of them are hazy"""


@dataclass(frozen=True)
class ModelSizeResults:
    """All models of one run."""

    machine: str
    objects: int
    """trained on"""
    tests: int
    """objects held out"""
    steps: int
    sizes: tuple[ModelSize, ...]


def sweep() -> tuple[tuple[str, int, FieldConfig], ...]:
    """The baseline, then every other value of each axis, then the default recipe: (axis, value, configuration)."""

    def varied(**change: Any) -> FieldConfig:
        return replace(BASELINE, **change)

    others = [(axis, value, varied(**{axis: value})) for axis, values in SWEEP.items() for value in values]
    return (("baseline", 0, BASELINE), *others, ("default", 0, RECIPES["default"].field))


def run(
    folders: Sequence[Path], tests: Sequence[ObjectEntry], steps: int, kept: Path
) -> Iterator[str | ModelSizeResults]:
    """Yields what is being done, and at the end the results.

    Args:
        folders: of the dataset to train on, which is read as a whole only where a model is missing.
        kept: where models and their scores are kept; what is there already is not done again.
    """
    category, entries = index_objects(folders)
    training = cache(lambda: hold_out(read_dataset(list(folders)))[0])
    chosen = sweep()
    paths = [kept / f"{category}-{axis}{value}-{steps}.safetensors" for axis, value, _ in chosen]
    models, scores = list[Model](), list[Scores]()
    for (_, _, config), path in zip(chosen, paths, strict=True):
        if not path.exists() or Model.load(path).field.config != config:
            yield from train_model(training(), replace(RECIPES["default"], field=config, steps=steps), path)
        models.append(load_trained(path, entries))
    training.cache_clear()
    views = trained_objects_views(entries, category, models[0])
    for path, model in zip(paths, models, strict=True):
        scores.append((yield from score_model(model, views, tests, path.with_suffix(".json"))))
    yield "speed"
    sizes = [_size(*row, first=scores[0]) for row in zip(chosen, models, paths, scores, _field_ms(models), strict=True)]
    yield ModelSizeResults(describe_machine(models[0].device), len(entries), len(tests), steps, tuple(sizes))


def _size(
    chosen: tuple[str, int, FieldConfig], model: Model, path: Path, scores: Scores, field_ms: float, first: Scores
) -> ModelSize:
    return ModelSize(
        *chosen[:2],
        parameters=sum(parameter.numel() for parameter in model.field.parameters()),
        bytes=path.stat().st_size,
        new_views=scores.new_views,
        held_out=mean_of(scores.held_out),
        gain=mean_of([psnr - other for psnr, other in zip(scores.held_out, first.held_out, strict=True)]),
        found=mean_of(scores.found),
        fit_seconds=median(scores.fit_seconds),
        field_ms=field_ms,
    )


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
