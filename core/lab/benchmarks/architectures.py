"""The paper's figure on disentanglement: CodeNeRF beside its entangled ablations M1 and M2, trained the same way.

Codes of two training objects are exchanged and the camera is moved, in a view that no model was trained on. Models are
kept, so that a run resumes where one was stopped.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from PIL import Image

from core.geometry.camera import Camera
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.figures import Cell, labelled_sheet, to_cell
from core.lab.benchmarks.machine import describe_machine
from core.lab.benchmarks.trained_models import Variant, train_variants, trained_objects_views
from core.lab.datasets.srn import Dataset, index_objects
from core.lab.evaluation.statistics import Mean, mean_of
from core.lab.training.recipes import RECIPES
from core.lab.training.trainer import held_out_psnr
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import Rendered, render_exact

ARCHITECTURES = {"M1": "M1", "M2": "M2", "CodeNeRF": "default"}  # name: recipe
_SAMPLES = 64  # intervals along a ray
_TURN = math.radians(60)
_SHOWN = 2  # objects


@dataclass(frozen=True)
class Architecture:
    """One model."""

    name: str
    parameters: int  # of the network
    new_views: float  # dB, views not trained on of training objects
    opacity_change: Mean
    """0..1, by which another object's texture code changes a pixel of the object: the mean of an image's pixels"""


@dataclass(frozen=True, eq=False)
class ArchitectureResults(Results[Architecture]):
    """All models of one run."""

    picture: Image.Image
    """of every model: an image, the same view rendered, with another texture, another shape, and from elsewhere"""


def measure_architectures(folders: Sequence[Path], steps: int, kept: Path) -> Iterator[str | ArchitectureResults]:
    """Yields what is being done, and at the end the results; models are kept in ``kept``."""
    category, entries = index_objects(folders)
    variants = [
        Variant(f"{category}-{name}", replace(RECIPES[recipe], steps=steps), entries)
        for name, recipe in ARCHITECTURES.items()
    ]
    trained = yield from train_variants(folders, variants, kept)
    found, rows = list[Architecture](), list[list[Cell]]()
    for name, one in zip(ARCHITECTURES, trained, strict=True):
        yield f"renders, {name}"
        views = trained_objects_views(entries, category, one.model)
        new_views = held_out_psnr(one.model, views)
        found.append(Architecture(name, one.parameters, new_views, _opacity_change(one.model, views)))
        rows += _rows(name, one.model, views)
    about = {"machine": describe_machine(trained[-1].model.device), "category": category}
    about |= {"objects": str(len(entries)), "steps": str(steps)}
    yield ArchitectureResults(about, tuple(found), labelled_sheet(rows))


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
