"""What each size of the network and the codes buys: models trained alike, of which each differs in one number.

The rule: from a centre, one axis at a time; last comes the size of our recipe, put together from what pays. All
are trained on the same objects with the same steps and the same random rays; what each is worth is written down beside
it, so that a run goes on where one was stopped. Their speed is measured at the end, turn about.
"""

import json
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import torch

from core.benchmarks import fits as fitting
from core.benchmarks.held_out_views import dataset_subjects
from core.benchmarks.rendering import machine
from core.datasets.srn import Dataset, ObjectPlace, find_objects, read_dataset
from core.evaluation.protocol import Mean, Protocol, evaluate, mean_of
from core.files import write_json
from core.fitting.confidence import RIGHT_DEGREES
from core.fitting.fit import PRESETS
from core.models.field import FieldConfig
from core.models.model import Model
from core.models.precision import autocast
from core.photos.view_bank import view_bank
from core.training.trainer import RECIPES, Trainer, held_out_psnr, hold_out

CENTRE = FieldConfig(width=128, shape_blocks=2, shape_latent=64, texture_latent=32, point_octaves=10)
AXES = {
    "width": (32, 64, 96, 256),
    "shape_latent": (8, 16, 32, 128),
    "texture_latent": (8, 16, 64),
    "shape_blocks": (1, 3),
    "point_octaves": (4, 6, 8),
}
_ROUNDS = 7
_POINTS = 100_000
_UNSEEN = 8
"""training objects of which a view that was not trained on is drawn"""
_EVERY = 5
"""Of a test object's other views each such one is drawn."""


@dataclass(frozen=True)
class Size:
    """One model."""

    axis: str
    """in which it differs from the centre; "centre" for that itself, "ours" for the size of our recipe"""
    value: int
    """there; 0 for these two"""
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
    field_ms: float
    """to ask the field for density and colour at 100,000 places: what a frame costs beside depends on how clean the
    object is, and so little training leaves all of them hazy"""


@dataclass(frozen=True)
class _Worth:
    """What is kept beside a model."""

    model: str
    """its fingerprint"""
    tests: list[str]
    """names of the test objects"""
    own: float
    """as in :class:`Size`"""
    held_out: list[float]
    """dB, of each test object"""
    found: list[float]
    """1 where its camera was found within 10 degrees, else 0"""
    fit_seconds: list[float]


@dataclass(frozen=True)
class Measured:
    """Everything that one run found."""

    machine: str
    objects: int
    """trained on"""
    tests: int
    """objects held out"""
    steps: int
    sizes: tuple[Size, ...]

    def told(self) -> dict:
        """As plain values."""
        return asdict(self)


def plan() -> tuple[tuple[str, int, FieldConfig], ...]:
    """The centre, then every other value of each axis, then that of our recipe: (axis, value, size)."""

    def varied(**change: Any) -> FieldConfig:
        return replace(CENTRE, **change)

    others = [(axis, value, varied(**{axis: value})) for axis, values in AXES.items() for value in values]
    return (("centre", 0, CENTRE), *others, ("ours", 0, RECIPES["ours"].field))


def measured(folders: Sequence[Path], tests: Sequence[ObjectPlace], steps: int, kept: Path) -> Iterator[str | Measured]:
    """What is being done now, and in the end all that was found. To stop, ask for no more.

    Args:
        folders: of the dataset to train on, which is read as a whole only where a model is missing.
        kept: where models are kept, and what was found of them; what is there already is not done again.
    """
    category, places = find_objects(folders)
    training = cache(lambda: hold_out(read_dataset(list(folders)))[0])
    chosen = plan()
    paths = [kept / f"{category}-{axis}{value}-{steps}.safetensors" for axis, value, _ in chosen]
    models, worths = list[Model](), list[_Worth]()
    for (_, _, config), path in zip(chosen, paths, strict=True):
        if not path.exists() or Model.load(path).field.config != config:
            yield from _train(training(), config, steps, path)
        models.append(Model.load(path))
    training.cache_clear()
    unseen = _unseen(places, category, models[0])
    for path, model in zip(paths, models, strict=True):
        worths.append((yield from _worth(model, unseen, tests, path.with_suffix(".json"))))
    yield "speed"
    sizes = [_size(*row, first=worths[0]) for row in zip(chosen, models, paths, worths, _field_ms(models), strict=True)]
    yield Measured(machine(models[0].device), len(places), len(tests), steps, tuple(sizes))


def _train(training: Dataset, config: FieldConfig, steps: int, path: Path) -> Iterator[str]:
    trainer = Trainer(training, replace(RECIPES["ours"], field=config, steps=steps))
    for step in trainer.steps():
        if step.step % 100 == 0:
            yield f"training, {path.stem}, step {step.step} of {steps}, {step.psnr:.1f} dB"
    trainer.model().save(path)


def _unseen(places: Sequence[ObjectPlace], category: str, model: Model) -> Dataset:
    """Of some training objects the view that none was trained on."""
    some = tuple(place.read() for place in places[:: max(1, len(places) // _UNSEEN)][:_UNSEEN])
    return hold_out(Dataset(some, category, model.image_size, model.focal), _UNSEEN)[1]


def _worth(model: Model, unseen: Dataset, tests: Sequence[ObjectPlace], path: Path) -> Generator[str, None, _Worth]:
    """What is being done now; returns what the model is worth, from ``path`` where that is known."""
    names = [place.name for place in tests]
    if path.exists():
        kept = json.loads(path.read_text())
        if (kept["model"], kept["tests"]) == (model.fingerprint, names):
            return _Worth(**kept)
    yield f"views of its own objects, {path.stem}"
    own = held_out_psnr(model, unseen)
    view_bank(model)  # made before the first fit is timed
    psnrs, blind = list[float](), list[fitting.Trial]()
    for number, place in enumerate(tests):
        yield f"fits, {path.stem}, {place.name}"
        psnrs += [score.psnr for score in evaluate(model, [place.read()], Protocol(every=_EVERY))]
        (subject,) = dataset_subjects(model, [place], torch.Generator().manual_seed(number))
        blind.append(fitting.trial(model, subject, "normal", PRESETS["normal"], number))
    found = [float(trial.off <= RIGHT_DEGREES) for trial in blind]
    worth = _Worth(model.fingerprint, names, own, psnrs, found, [trial.seconds for trial in blind])
    write_json(path, asdict(worth))
    return worth


def _size(
    chosen: tuple[str, int, FieldConfig], model: Model, path: Path, worth: _Worth, field_ms: float, first: _Worth
) -> Size:
    return Size(
        *chosen,
        parameters=sum(parameter.numel() for parameter in model.field.parameters()),
        bytes=path.stat().st_size,
        own=worth.own,
        held_out=mean_of(worth.held_out),
        gain=mean_of([psnr - other for psnr, other in zip(worth.held_out, first.held_out, strict=True)]),
        found=mean_of(worth.found),
        fit_seconds=median(worth.fit_seconds),
        field_ms=field_ms,
    )


@torch.no_grad()
def _field_ms(models: Sequence[Model]) -> list[float]:
    """Of every model, median over rounds in which all take turns."""
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
