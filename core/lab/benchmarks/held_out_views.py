"""Test cases of fits: views of objects whose cameras are known."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.fit import PRESETS, FitJob, fit
from core.geometry.camera import Camera
from core.lab.datasets.splits import evenly_spaced
from core.lab.datasets.srn import ObjectEntry, ObjectViews
from core.lab.evaluation.protocol import as_photo
from core.metrics import psnr, rotation_error
from core.models.model import Instance, Model
from core.rendering.images import render_image

HELD_OUT_VIEWS = 4  # other views of each object that score its fit
_BACKGROUND = 0.99
"""brightness of all channels above which a pixel is background, for networks that render the background"""
_NEAR_DEGREES = 8.0  # spacing of the views of a test spiral
_SAME_FOCAL = 0.02  # logarithm of the ratio


@dataclass(frozen=True, eq=False)
class HeldOutView:
    """An object and a view of it, to be fitted without its camera."""

    views: ObjectViews
    index: int  # of the fitted view
    instance: Instance
    """the object's own; of an object that the model was not trained on, fitted to a few views with their cameras"""
    full_size: ObjectViews | None = None  # the same views at the dataset's size; None if that is the model's

    @property
    def camera(self) -> Camera:
        """The true camera of the fitted view."""
        return self.views.cameras[self.index]

    def nearest(self, camera: Camera) -> int | None:
        """Return the index of the nearest view to a camera; None if none is near and of its focal length."""
        errors = [
            math.inf if abs(math.log(view.focal / camera.focal)) > _SAME_FOCAL else rotation_error(view, camera)
            for view in self.views.cameras
        ]
        index = int(np.argmin(errors))
        return index if errors[index] < _NEAR_DEGREES else None


def training_object_views(model: Model, count: int, generator: torch.Generator) -> Iterator[HeldOutView]:
    """Yield training objects, evenly spaced over the model, rendered from random cameras on the upper hemisphere."""
    for index in evenly_spaced(model.codes.valid, count):
        name = model.codes.objects[index].name
        instance = model[index]
        cameras = tuple(random_camera(model, generator) for _ in range(1 + HELD_OUT_VIEWS))
        renders = [render_on_white(instance, camera) for camera in cameras]
        images = np.stack([(colour * 255 + 0.5).byte().numpy() for colour, _ in renders])
        masks = np.stack([mask.numpy() for _, mask in renders])
        yield HeldOutView(ObjectViews(name, name, name, images, masks, cameras), 0, instance)


def dataset_views(model: Model, entries: Sequence[ObjectEntry], generator: torch.Generator) -> Iterator[HeldOutView]:
    """Yield one random view of every object of a dataset."""
    for entry in entries:
        full_size = entry.read()
        views = full_size.reduced(model.image_size)
        stride = -(-len(views.cameras) // HELD_OUT_VIEWS)
        photos = tuple(as_photo(views, index, True) for index in range(0, len(views.cameras), stride))
        *_, last = fit(model, FitJob(photos, PRESETS["draft"]))
        index = int(torch.randint(len(views.cameras), (), generator=generator))
        yield HeldOutView(views, index, last.instance, full_size)


def random_camera(model: Model, generator: torch.Generator) -> Camera:
    """Return a camera whose direction is uniform on the upper hemisphere."""
    turn, height = torch.rand(2, generator=generator).tolist()
    return model.camera(2 * math.pi * turn, math.asin(height))


def is_symmetric_view(instance: Instance, fitted: Camera, truth: Camera, degrees: float) -> bool:
    """Return whether both cameras show an object as alike as when the true one turns by ``degrees``.

    A round stool has several right cameras; the one that rendered its image is no better than the others.
    """
    lift = math.radians(degrees) * (-1 if truth.elevation > 0 else 1)
    turned = (
        replace(truth, azimuth=truth.azimuth + math.radians(degrees)),
        replace(truth, elevation=truth.elevation + lift),
    )
    fitted_image, true_image = (render_on_white(instance, camera)[0] for camera in (fitted, truth))
    turned_images = (render_on_white(instance, camera)[0] for camera in turned)
    return psnr(fitted_image, true_image) >= min(psnr(image, true_image) for image in turned_images)


def render_on_white(
    instance: Instance, camera: Camera
) -> tuple[Float[Tensor, "height width 3"], Bool[Tensor, "height width"]]:
    """Return an image in [0, 1] and the object's mask."""
    rendered = render_image(instance, camera)
    colour = rendered.colour.clamp(0, 1).cpu()
    return colour, (colour < _BACKGROUND).any(-1) if instance.model.white_from_network else rendered.opacity.cpu() > 0.5
