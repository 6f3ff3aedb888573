"""The paper's figure on disentanglement: CodeNeRF beside its entangled ablations M1 and M2, trained the same way.

Codes of two training objects are exchanged and the camera is moved, in a view that no model was trained on. Models are
kept, so that a run resumes where one was stopped.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import torch
from PIL import Image

from core.geometry.camera import Camera
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.figures import Cell, labelled_sheet, to_cell
from core.lab.benchmarks.machine import describe_machine
from core.lab.datasets.srn import Dataset, ObjectEntry, index_objects, read_dataset
from core.lab.evaluation.statistics import Mean, mean_of
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import Trainer, held_out_psnr, hold_out
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import Rendered, render_exact

ARCHITECTURES = {"M1": "M1", "M2": "M2", "CodeNeRF": "default"}
"""name: recipe"""
_SAMPLES = 64
"""intervals along a ray"""
_TURN = math.radians(60)
_SHOWN = 2
"""objects"""
_NEW_VIEWS = 8
"""training objects of which a view that was not trained on is rendered"""


@dataclass(frozen=True)
class Architecture:
    """One model."""

    name: str
    parameters: int
    """of the network"""
    new_views: float
    """dB, views not trained on of training objects"""
    opacity_change: Mean
    """0..1, by which another object's texture code changes a pixel of the object: the mean of an image's pixels"""


@dataclass(frozen=True, eq=False)
class ArchitectureResults(Results[Architecture]):
    """All models of one run."""

    picture: Image.Image
    """of every model: an image, the same view rendered, with another texture, another shape, and from elsewhere"""


def measure_architectures(folders: Sequence[Path], steps: int, kept: Path) -> Iterator[str | ArchitectureResults]:
    """Yields what is being done, and at the end the results; models are kept in ``kept``.

    Raises ``ValueError`` where a kept model was trained on other objects.
    """
    category, entries = index_objects(folders)
    training = cache(lambda: hold_out(read_dataset(folders))[0])  # read only where a model is missing
    found, rows = list[Architecture](), list[list[Cell]]()
    for name, recipe in ARCHITECTURES.items():
        path, settings = kept / f"{category}-{name}-{steps}.safetensors", replace(RECIPES[recipe], steps=steps)
        if not path.exists() or Model.load(path).field.config != settings.field:
            yield from _train(training(), settings, path)
        model = _load(path, entries)
        yield f"renders, {name}"
        views = _new_views(entries, category, model)
        parameters = sum(parameter.numel() for parameter in model.field.parameters())
        found.append(Architecture(name, parameters, held_out_psnr(model, views), _opacity_change(model, views)))
        rows += _rows(name, model, views)
    about = {"machine": describe_machine(model.device), "category": category}
    about |= {"objects": str(len(entries)), "steps": str(steps)}
    yield ArchitectureResults(about, tuple(found), labelled_sheet(rows))


def _train(dataset: Dataset, settings: TrainSettings, path: Path) -> Iterator[str]:
    trainer = Trainer(dataset, settings)
    for step in trainer.steps():
        if step.step % 100 == 0:
            yield f"training, {path.stem}, step {step.step} of {settings.steps}, {step.psnr:.1f} dB"
    trainer.model().save(path)


def _load(path: Path, entries: Sequence[ObjectEntry]) -> Model:
    model = Model.load(path)
    if {entry.name for entry in model.codes.objects} != {entry.name for entry in entries}:
        raise ValueError(f"{path} was trained on other objects; keep models of these in another folder")
    return model


def _new_views(entries: Sequence[ObjectEntry], category: str, model: Model) -> Dataset:
    """Of some training objects, evenly over ``entries``, the view that no model was trained on."""
    some = tuple(entry.read() for entry in entries[:: max(1, len(entries) // _NEW_VIEWS)][:_NEW_VIEWS])
    return hold_out(Dataset(some, category, model.image_size, model.focal), _NEW_VIEWS)[1]


def _others(model: Model, views: Dataset) -> list[tuple[Codes, Codes, Camera]]:
    """Of every object its codes, those of the object after next (the next may share a code), and the camera."""
    index = {entry.name: row for row, entry in enumerate(model.codes.objects)}
    codes = [model.codes[index[one.name]] for one in views.objects]
    following = codes[2:] + codes[:2]
    return [(own, other, one.cameras[0]) for own, other, one in zip(codes, following, views.objects, strict=True)]


def _opacity_change(model: Model, views: Dataset) -> Mean:
    changes = []
    for codes, other, camera in _others(model, views):
        before, after = (
            _render(model, Codes(codes.shape, texture), camera).opacity for texture in (codes.texture, other.texture)
        )
        shown = (before > 0.5) | (after > 0.5)
        if not bool(shown.any()):
            raise ValueError("a model shows no object yet: train it for more steps")
        changes.append(float((after - before).abs()[shown].mean()))
    return mean_of(changes)


def _rows(name: str, model: Model, views: Dataset) -> list[list[Cell]]:
    rows = []
    # Every other object: the first is beside the one whose codes it is given, two further on.
    for (codes, other, camera), one in list(zip(_others(model, views), views.objects, strict=True))[::2][:_SHOWN]:
        turned = replace(camera, azimuth=camera.azimuth + _TURN)
        shown = {
            name: (codes, camera),
            "other texture": (Codes(codes.shape, other.texture), camera),
            "other shape": (Codes(other.shape, codes.texture), camera),
            "both": (other, camera),
            "other viewpoint": (codes, turned),
        }
        image = to_cell("new view", torch.from_numpy(one.images[0]) / 255)
        renders = [to_cell(label, _render(model, *what).colour.clamp(0, 1)) for label, what in shown.items()]
        rows.append([image, *renders])
    return rows


def _render(model: Model, codes: Codes, camera: Camera) -> Rendered:
    return render_exact(model, codes, camera, _SAMPLES)
