"""Training of :mod:`core.classifiers.viewpoint` on augmented images of a dataset."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.classifiers.viewpoint import ViewpointClassifier, crop_to_object, direction_weights, directions
from core.geometry.camera import camera_rotation
from core.lab.datasets.srn import Dataset
from core.lab.training.augmentation import augment_photo

BATCH_SIZE = 96  # images
_PEAK_LR = 2e-3
_KERNEL_WIDTH = math.radians(9)  # rad; width of the target distribution around the true direction


class ViewpointDataset(NamedTuple):
    """Network inputs and their true directions."""

    images: Float[Tensor, "images 4 side side"]
    azimuth: Float[Tensor, "images"]
    elevation: Float[Tensor, "images"]  # rad


def viewpoint_dataset(dataset: Dataset) -> ViewpointDataset:
    """Crop all images with a non-empty mask. Raises ``ValueError`` if there are none."""
    images = list[Tensor]()
    angles = list[tuple[float, float]]()
    for views in dataset.objects:
        for image, mask, camera in zip(views.images, views.masks, views.cameras, strict=True):
            if mask.any():
                crop = crop_to_object(torch.from_numpy(image).float() / 255, torch.from_numpy(mask))
                images.append((255 * crop + 0.5).to(torch.uint8))
                angles.append((camera.azimuth, camera.elevation))
    if not images:
        raise ValueError("there is nothing to train on: every mask is empty")
    return ViewpointDataset(torch.stack(images), *torch.tensor(angles).unbind(1))


def train_viewpoint(
    classifier: ViewpointClassifier, dataset: ViewpointDataset, steps: int, seed: int = 0
) -> Iterator[float]:
    """Train a network in place, yielding the loss of each step; to stop, abandon the iterator."""
    generator = torch.Generator().manual_seed(seed)
    optimiser = torch.optim.AdamW(classifier.parameters(), _PEAK_LR, weight_decay=1e-2)
    classifier.requires_grad_(True).train()
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = _PEAK_LR * (0.01 + 0.99 * (1 + math.cos(math.pi * step / steps)) / 2)
        index = torch.randint(len(dataset.images), (BATCH_SIZE,), generator=generator)
        images, azimuth = augment_photo(dataset.images[index].float() / 255, dataset.azimuth[index], generator)
        target = direction_weights(azimuth, dataset.elevation[index], _KERNEL_WIDTH)
        loss = functional.cross_entropy(classifier(images), target)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        yield float(loss.detach())
    classifier.requires_grad_(False).eval()


def accuracy_within(classifier: ViewpointClassifier, dataset: ViewpointDataset, within: float) -> float:
    """Return the fraction of images whose likeliest direction is within ``within`` rad of the true one."""
    likeliest = torch.cat([classifier(batch.float() / 255).argmax(1) for batch in dataset.images.split(256)])
    azimuths, elevations = directions()
    predicted = camera_rotation(azimuths[likeliest], elevations[likeliest])
    true = camera_rotation(dataset.azimuth, dataset.elevation)
    cosine = ((predicted * true).sum((-2, -1)) - 1) / 2
    return float((cosine > math.cos(within)).float().mean())
