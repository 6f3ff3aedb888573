"""Views held out of training, and the PSNR of a model on them."""

from dataclasses import replace

import torch

from core.lab.datasets.srn import Dataset, ObjectViews
from core.metrics import psnr
from core.models.model import Model
from core.rendering.reference import render_exact

_MEASURED_OBJECTS = 8  # objects whose held-out views are compared during training


def hold_out(dataset: Dataset) -> tuple[Dataset, Dataset]:
    """Split off the last view of every object; return the rest, and those views of a few evenly spaced objects.

    Raises ``ValueError`` for an object with a single view.
    """
    if min(len(views.cameras) for views in dataset.objects) < 2:
        raise ValueError("training needs at least two views of every object: one is held out for validation")
    training = tuple(_selected(views, slice(None, -1)) for views in dataset.objects)
    measured = dataset.objects[:: max(1, len(dataset.objects) // _MEASURED_OBJECTS)][:_MEASURED_OBJECTS]
    held_out = tuple(_selected(views, slice(-1, None)) for views in measured)
    return replace(dataset, objects=training), replace(dataset, objects=held_out, weights=())


def _selected(views: ObjectViews, rows: slice) -> ObjectViews:
    return replace(views, images=views.images[rows], masks=views.masks[rows], cameras=views.cameras[rows])


def held_out_psnr(model: Model, dataset: Dataset, samples: int = 64) -> float:
    """Return the mean PSNR (dB) of a model's training objects over held-out whole images."""
    values = list[float]()
    for views in dataset.objects:
        instance = model[model.codes.index[views.name]]
        for image, camera in zip(views.images, views.cameras, strict=True):
            colour = render_exact(instance, camera, samples).colour.clamp(0, 1)
            values.append(psnr(colour, torch.from_numpy(image).float() / 255))
    return sum(values) / len(values)
