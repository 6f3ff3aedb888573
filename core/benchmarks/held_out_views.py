"""What fits are measured on: views of objects whose cameras are known."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.datasets.srn import ObjectEntry, ObjectViews
from core.evaluation.protocol import photo
from core.fitting.fit import PRESETS, FitJob, fit
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.fast import render
from core.rendering.progressive import RenderSettings
from core.rendering.reference import render_exact

OTHERS = 4
"""views that a model's own object is judged on, beside the one that is fitted"""
_GROUND = 0.99
"""A pixel that is brighter in all channels is ground, where the network paints it."""


class Subject(NamedTuple):
    """An object, and which of its views is fitted."""

    views: ObjectViews
    view: int
    codes: Codes
    """what it was drawn from; or what a few of its views with their cameras were fitted to"""

    @property
    def camera(self) -> Camera:
        """The true one."""
        return self.views.cameras[self.view]


def own_subjects(model: Model, count: int, generator: torch.Generator) -> Iterator[Subject]:
    """Objects spread over the model, seen from anywhere on the upper half."""
    for name, codes in spread_objects(model, count):
        cameras = tuple(anywhere(model, generator) for _ in range(1 + OTHERS))
        drawn = [drawn_on_white(model, codes, camera) for camera in cameras]
        images = np.stack([(colour * 255 + 0.5).byte().numpy() for colour, _ in drawn])
        yield Subject(
            ObjectViews(name, name, name, images, np.stack([mask.numpy() for _, mask in drawn]), cameras), 0, codes
        )


def dataset_subjects(model: Model, places: Sequence[ObjectEntry], generator: torch.Generator) -> Iterator[Subject]:
    """A view of every object of a dataset, drawn by lot."""
    for place in places:
        views = place.read()
        some = tuple(
            photo(views, index, True) for index in range(0, len(views.cameras), -(-len(views.cameras) // OTHERS))
        )
        *_, known = fit(model, FitJob(some, PRESETS["draft"]))
        yield Subject(views, int(torch.randint(len(views.cameras), (), generator=generator)), known.codes)


def spread_objects(model: Model, count: int) -> list[tuple[str, Codes]]:
    """So many of a model's valid objects, evenly spread, with their names."""
    valid = model.codes.valid
    some = [valid[index * len(valid) // count] for index in range(min(count, len(valid)))]
    return [(model.codes.objects[index].name, model.codes[index]) for index in some]


def anywhere(model: Model, generator: torch.Generator) -> Camera:
    """A camera on the upper half of the sphere, no direction likelier than another."""
    turn, height = torch.rand(2, generator=generator).tolist()
    return model.camera(2 * math.pi * turn, math.asin(height))


def looks_alike(model: Model, codes: Codes, found: Camera, truth: Camera, degrees: float) -> bool:
    """Whether an object looks as from its true camera: no less than if that were so many degrees off.

    A stool has several right cameras, and the one that its picture was drawn from is none more right than the others.
    """
    lift = math.radians(degrees) * (-1 if truth.elevation > 0 else 1)
    off = (
        replace(truth, azimuth=truth.azimuth + math.radians(degrees)),
        replace(truth, elevation=truth.elevation + lift),
    )
    seen, picture = (drawn_on_white(model, codes, camera)[0] for camera in (found, truth))
    return psnr(seen, picture) >= min(psnr(drawn_on_white(model, codes, camera)[0], picture) for camera in off)


def drawn_on_white(
    model: Model, codes: Codes, camera: Camera
) -> tuple[Float[Tensor, "height width 3"], Bool[Tensor, "height width"]]:
    """A picture in [0, 1] and where the object is on it."""
    if model.white_from_network:
        colour = render_exact(model, codes, camera, 64).colour.clamp(0, 1).cpu()
        return colour, (colour < _GROUND).any(-1)
    seen = render(model, codes, camera, RenderSettings().samples)
    return seen.colour.clamp(0, 1).cpu(), seen.opacity.cpu() > 0.5
