"""Training :mod:`core.models.viewpoint` on the pictures of a dataset, in disguise: other colours, sizes and places."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.datasets.srn import Dataset
from core.geometry.camera import rotation
from core.models.viewpoint import ViewpointClassifier, crop_to_object, direction_weights, directions

_BATCH = 96
_RATE = 2e-3
_BLUR = math.radians(9)
"""how far from the true direction others count as right"""
_COLOURS, _BRIGHTNESS, _INVERTED = 0.35, 0.2, 0.15
"""by how much colours are mixed and shifted, and how often they are inverted"""
_SCALE, _ASPECT, _SHIFT = 0.06, 0.08, 0.04
"""standard deviations of an object's size, of its proportions and, in half pictures, of its place"""


class Glimpses(NamedTuple):
    """Pictures as the network sees them, and their cameras."""

    pictures: Float[Tensor, "pictures 4 side side"]
    azimuth: Float[Tensor, "pictures"]
    elevation: Float[Tensor, "pictures"]
    """rad"""


@dataclass(frozen=True)
class GlanceStep:
    """Where the training stands."""

    step: int
    steps: int
    loss: float


def glimpses(dataset: Dataset) -> Glimpses:
    """Of all pictures that show anything."""
    pictures, angles = [], []
    for views in dataset.objects:
        for image, mask, camera in zip(views.images, views.masks, views.cameras, strict=True):
            if mask.any():
                seen = crop_to_object(torch.from_numpy(image).float() / 255, torch.from_numpy(mask))
                pictures.append((255 * seen + 0.5).to(torch.uint8))
                angles.append((camera.azimuth, camera.elevation))
    if not pictures:
        raise ValueError("there is nothing to look at: every mask is empty")
    return Glimpses(torch.stack(pictures), *torch.tensor(angles).unbind(1))


def taught(glance: ViewpointClassifier, seen: Glimpses, steps: int, seed: int = 0) -> Iterator[GlanceStep]:
    """Train a network, one step per value; to stop, ask for no more."""
    dice = torch.Generator().manual_seed(seed)
    optimiser = torch.optim.AdamW(glance.parameters(), _RATE, weight_decay=1e-2)
    glance.requires_grad_(True).train()
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = _RATE * (0.01 + 0.99 * (1 + math.cos(math.pi * step / steps)) / 2)
        chosen = torch.randint(len(seen.pictures), (_BATCH,), generator=dice)
        pictures, azimuth = disguised(seen.pictures[chosen].float() / 255, seen.azimuth[chosen], dice)
        right = direction_weights(azimuth, seen.elevation[chosen], _BLUR)
        loss = functional.cross_entropy(glance(pictures), right)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        yield GlanceStep(step + 1, steps, float(loss.detach()))
    glance.requires_grad_(False).eval()


def disguised(
    pictures: Float[Tensor, "pictures 4 side side"], azimuth: Float[Tensor, "pictures"], dice: torch.Generator
) -> tuple[Float[Tensor, "pictures 4 side side"], Float[Tensor, "pictures"]]:
    """The pictures in other colours, other sizes and places, half of them mirrored; and their azimuths then.

    A mirrored object is one seen from the other side of its front (azimuth 90 degrees).
    """
    count = len(pictures)

    def normal(spread: float, *shape: int) -> Tensor:
        return spread * torch.randn(count, *shape, generator=dice)

    mixing = torch.eye(3) + normal(_COLOURS, 3, 3)
    colours = torch.einsum("nij,njhw->nihw", mixing, pictures[:, :3] - 0.5) + 0.5 + normal(_BRIGHTNESS, 3, 1, 1)
    inverted, mirrored = (torch.rand(2, count, generator=dice) < torch.tensor([[_INVERTED], [0.5]])).unbind()
    colours = torch.where(inverted[:, None, None, None], 1 - colours, colours).clamp(0, 1)
    mask = pictures[:, 3:]
    seen = torch.cat(((colours - 1) * mask, mask), 1)
    placed = torch.zeros(count, 2, 3)
    size = 1 + normal(_SCALE)
    placed[:, 0, 0] = size * (1 + normal(_ASPECT)) * torch.where(mirrored, -1.0, 1.0)
    placed[:, 1, 1] = size * (1 + normal(_ASPECT))
    placed[:, :, 2] = normal(_SHIFT, 2)
    grid = functional.affine_grid(placed, list(seen.shape), align_corners=False)
    seen = functional.grid_sample(seen, grid, align_corners=False)
    return torch.cat((seen[:, :3] + 1, seen[:, 3:]), 1), torch.where(mirrored, math.pi - azimuth, azimuth)


def share_recognised(glance: ViewpointClassifier, seen: Glimpses, within: float) -> float:
    """The share of pictures whose likeliest direction is within so many rad of the true one, 0..1."""
    likely = torch.cat([glance(part.float() / 255).argmax(1) for part in seen.pictures.split(256)])
    guess, truth = (rotation(*angles) for angles in ([one[likely] for one in directions()], seen[1:]))
    cosine = ((guess * truth).sum((-2, -1)) - 1) / 2
    return float((cosine > math.cos(within)).float().mean())
