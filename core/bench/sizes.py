"""What each size of the network and the codes buys: models trained alike, of which each differs in one number.

The rule: from the default, one axis at a time. All are trained on the same objects with the same steps and the same
random rays; what they cost is measured afterwards, turn about.
"""

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import torch

from core.bench import fitting
from core.bench.rendering import machine
from core.bench.subjects import dataset_subjects, spread_objects
from core.dataset import Dataset, ObjectPlace
from core.evaluate import Mean, Protocol, evaluate, mean_of
from core.field import FieldConfig
from core.fit import PRESETS
from core.frames import RenderSettings
from core.march import forget_views, marched
from core.model import Model
from core.starts import bank_of
from core.train import RECIPES, Trainer, held_out_psnr, hold_out

DEFAULT = FieldConfig(shape_latent=64, texture_latent=32)
AXES = {
    "width": (32, 64, 96, 256),
    "shape_latent": (8, 16, 32, 128),
    "texture_latent": (8, 16, 64),
    "shape_blocks": (1, 3),
    "point_octaves": (4, 6, 8),
}
_ROUNDS = 7
_VIEWS = 3


@dataclass(frozen=True)
class Size:
    """One model."""

    axis: str
    """in which it differs from the default; "default" for that itself"""
    value: int
    config: FieldConfig
    parameters: int
    """of the network"""
    bytes: int
    """of the model file, codes included"""
    own: float
    """dB, views not trained on of training objects"""
    held_out: Mean
    """dB, other views of objects never trained on, fitted on one view from its true camera"""
    gain: Mean
    """dB, of the same objects over the first model's"""
    found: Mean
    """share of the same objects' cameras found within 10 degrees, from a view drawn by lot"""
    fit_seconds: float
    """median of these blind fits"""
    frame_ms: float
    """a 128 px frame from a new side, 64 intervals"""


@dataclass(frozen=True)
class Measured:
    """Everything that one run found."""

    machine: str
    objects: int
    """trained on"""
    steps: int
    sizes: tuple[Size, ...]

    def told(self) -> dict:
        """As plain values."""
        return asdict(self)


def plan() -> tuple[tuple[str, int, FieldConfig], ...]:
    """The default, then every other value of each axis: (axis, value, size)."""

    def varied(**change: Any) -> FieldConfig:
        return replace(DEFAULT, **change)

    others = [(axis, value, varied(**{axis: value})) for axis, values in AXES.items() for value in values]
    return (("default", 0, DEFAULT), *others)


def measured(
    dataset: Dataset, tests: Sequence[ObjectPlace], steps: int, folder: Path, only: slice = slice(None)
) -> Iterator[str | Measured]:
    """What is being done now, and in the end all that was found. To stop, ask for no more.

    Args:
        folder: where models are kept; one that is there already is not trained again.
        only: part of :func:`plan`.
    """
    training, unseen = hold_out(dataset, 16)
    chosen = plan()[only]
    paths = [folder / f"{dataset.category}-{axis}{value}-{steps}.safetensors" for axis, value, _ in chosen]
    models = list[Model]()
    for (_, _, config), path in zip(chosen, paths, strict=True):
        models.append((yield from _trained(training, config, steps, path)))
    yield "frames"
    sizes, first = [], list[float]()
    for (axis, value, config), path, model, ms in zip(chosen, paths, models, _frame_ms(models), strict=True):
        yield f"fits, {path.stem}"
        psnrs = [score.psnr for score in evaluate(model, (place.read() for place in tests), Protocol())]
        first = first or psnrs
        yield f"blind fits, {path.stem}"
        blind = _blind(model, tests)
        sizes.append(
            Size(
                *(axis, value, config, sum(p.numel() for p in model.field.parameters()), path.stat().st_size),
                own=held_out_psnr(model, unseen),
                held_out=mean_of(psnrs),
                gain=mean_of([psnr - other for psnr, other in zip(psnrs, first, strict=True)]),
                found=blind.within_10_degrees,
                fit_seconds=blind.seconds,
                frame_ms=ms,
            )
        )
    yield Measured(machine(models[0].device), len(training.objects), steps, tuple(sizes))


def _trained(training: Dataset, config: FieldConfig, steps: int, path: Path) -> Generator[str, None, Model]:
    """What is being done now; returns the model."""
    if not path.exists():
        trainer = Trainer(training, replace(RECIPES["ours"], field=config, steps=steps))
        for step in trainer.steps():
            if step.step % 100 == 0:
                yield f"training, {path.stem}, step {step.step} of {steps}, {step.psnr:.1f} dB"
        trainer.model().save(path)
    return Model.load(path)


def _blind(model: Model, tests: Sequence[ObjectPlace]) -> fitting.Summary:
    bank_of(model)  # made before the first fit is timed
    subjects = dataset_subjects(model, tests, torch.Generator().manual_seed(0))
    trials = [
        fitting.trial(model, subject, "normal", PRESETS["normal"], number) for number, subject in enumerate(subjects)
    ]
    return fitting.summary("normal", trials)


def _frame_ms(models: Sequence[Model]) -> list[float]:
    """Of every model, median over rounds in which all take turns."""
    times: list[list[float]] = [[] for _ in models]
    for turn in range(_ROUNDS + 1):
        for model, taken in zip(models, times, strict=True):
            for index, (_, codes) in enumerate(spread_objects(model, _VIEWS)):
                forget_views()
                camera = model.camera(2.4 * index + 0.9, 0.4)
                began = time.perf_counter()
                marched(model, codes, camera, RenderSettings().moving)
                if turn:
                    taken.append(1000 * (time.perf_counter() - began))
    return [median(taken) for taken in times]
