"""The viewpoint classifier: a small network that predicts from which direction an image shows an object.

The view bank (:mod:`core.models.view_bank`) compares silhouettes of a few prototypes, and a new object may resemble
them from many sides. This network was trained on augmented training images and recognises a front. It predicts no
codes: its output is a prior on the camera's direction, on a grid.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from core.geometry.camera import FRONT_AZIMUTH, camera_rotation
from core.geometry.pixels import bounding_box

SIDE = 48  # px, of the input
CROP_MARGIN = 1.12  # side of the square input, over the longer side of the object's box
_CHANNELS = (20, 40, 64, 80)
_BOTTLENECK = 32
_HIDDEN = 96
AZIMUTHS = 24
ELEVATIONS = (-25.0, -5.0, 10.0, 25.0, 40.0, 58.0, 78.0)
"""degrees; near the pole azimuth is image roll, so every elevation has all azimuths"""
_DIRECTIONS = AZIMUTHS * len(ELEVATIONS)
_UNIFORM_MIX = 0.05
"""Weight of the uniform distribution in every prediction: the classifier is confident and wrong this often."""
_KERNEL_WIDTH = math.radians(12)  # Width of the Gaussian that spreads a direction's probability over the grid.
_WITNESS_RIGHT, _WITNESS_MIRRORED, _WITNESS_WRONG = 0.66, 0.23, 0.11
_WITNESS_WIDTH = math.radians(15)
"""Frequencies of Objectron's azimuth, its mirror image and neither, on renders of validation and foreign chairs."""
Side = Literal["front", "left", "back", "right", "above"]
SIDES: dict[Side, float] = {
    "front": FRONT_AZIMUTH,
    "left": FRONT_AZIMUTH + math.pi / 2,
    "back": FRONT_AZIMUTH + math.pi,
    "right": FRONT_AZIMUTH - math.pi / 2,
    "above": math.nan,
}  # azimuth (rad) of a camera that sees this side; from above, any
SEEN_ANGLE = math.radians(60)  # a photo shows the sides of an object that are turned away from it by less
_SEES_TOP = math.radians(20)  # elevation from which a photo shows the top
_SIDE_WIDTH = math.radians(30)
_SIDE_WRONG = 0.05  # likelihood of directions far from the named side, relative to its middle


class ViewpointClassifier(nn.Module):
    """Convolutional network from (images, 4, SIDE, SIDE) of :func:`crop_to_object` to :func:`directions`."""

    def __init__(self) -> None:
        super().__init__()
        sizes = (4, *_CHANNELS)
        self.layers = nn.ModuleList(nn.Conv2d(inputs, outputs, 3, 2, 1) for inputs, outputs in pairwise(sizes))
        self.fewer = nn.Conv2d(sizes[-1], _BOTTLENECK, 1)
        self.hidden = nn.Linear(_BOTTLENECK * (SIDE // 2 ** len(_CHANNELS)) ** 2, _HIDDEN)
        self.last = nn.Linear(_HIDDEN, _DIRECTIONS)

    def forward(self, images: Float[Tensor, "images 4 side side"]) -> Float[Tensor, "images directions"]:
        """Return logits of the directions; applies dropout while training."""
        y = 2 * images - 1
        for layer in (*self.layers, self.fewer):
            y = layer(y).relu()
        y = self.hidden(y.flatten(1)).relu()
        return self.last(functional.dropout(y, 0.1, self.training))


@lru_cache(maxsize=1)
def directions() -> tuple[Float[Tensor, "directions"], Float[Tensor, "directions"]]:
    """Return azimuths and elevations of the grid (rad), elevation by elevation; cached, do not modify."""
    elevation, azimuth = torch.meshgrid(
        torch.tensor(ELEVATIONS).deg2rad(), torch.arange(AZIMUTHS) * (2 * math.pi / AZIMUTHS), indexing="ij"
    )
    return azimuth.flatten(), elevation.flatten()


def uniform_directions() -> Float[Tensor, "directions"]:
    """Return equal probabilities of all directions."""
    return torch.full((_DIRECTIONS,), 1 / _DIRECTIONS)


def direction_weights(
    azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"], width: float = _KERNEL_WIDTH
) -> Float[Tensor, "*batch directions"]:
    """Return Gaussian weights of cameras (rad) over the directions of the grid; they add up to 1."""
    turned = camera_rotation(azimuth, elevation).flatten(-2) @ camera_rotation(*directions()).flatten(-2).T
    angle = ((turned - 1) / 2).clamp(-1, 1).acos()
    return (-(angle / width).square() / 2).softmax(-1)


def crop_to_object(
    pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "4 side side"]:
    """Crop an image to a square around the object, as the network's input: rgb on white and the mask."""
    left, top, right, bottom = bounding_box(mask)
    steps = CROP_MARGIN * max(right - left, bottom - top) / 2 * ((torch.arange(2 * SIDE) + 0.5) / SIDE - 1)
    y = ((top + bottom) / 2 + steps) / mask.shape[0] * 2 - 1
    x = ((left + right) / 2 + steps) / mask.shape[1] * 2 - 1
    grid = torch.stack(torch.broadcast_tensors(x[None, :], y[:, None]), -1)
    inside = mask[..., None].float()
    image = torch.cat(((pixels - 1) * inside, inside), -1).movedim(-1, 0)[None]
    crop = functional.avg_pool2d(functional.grid_sample(image, grid[None], align_corners=False), 2)[0]
    return torch.cat((crop[:3] + 1, crop[3:]))


@torch.no_grad()
def predict_viewpoint(
    classifier: ViewpointClassifier, pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "directions"]:
    """Return the probability of every direction of the grid for one image; they add up to 1.

    Args:
        pixels: 0..1.
        mask: True on the object; must not be empty.
    """
    return torch.lerp(
        classifier(crop_to_object(pixels, mask)[None])[0].softmax(-1), torch.tensor(1 / _DIRECTIONS), _UNIFORM_MIX
    )


def with_witness(
    probability: Float[Tensor, "directions"], azimuth: float, elevation: float
) -> Float[Tensor, "directions"]:
    """Combine the probabilities of directions with the camera (rad) that a second witness predicts.

    The witness may confuse front and back (-azimuth) or be wrong altogether.
    """
    azimuths, elevations = (grid.reshape(-1, AZIMUTHS) for grid in directions())
    azimuth_likelihood = torch.full((AZIMUTHS,), _WITNESS_WRONG / AZIMUTHS)
    for candidate, frequency in ((azimuth, _WITNESS_RIGHT), (-azimuth, _WITNESS_MIRRORED)):
        angle = torch.remainder(azimuths[0] - candidate + math.pi, 2 * math.pi) - math.pi
        kernel = _gaussian(angle, _WITNESS_WIDTH)
        azimuth_likelihood += frequency * kernel / kernel.sum()
    kernel = _gaussian(elevations[:, :1] - elevation, _WITNESS_WIDTH)
    elevation_likelihood = (1 - _WITNESS_WRONG) * kernel + _WITNESS_WRONG
    posterior = probability.reshape(-1, AZIMUTHS) * elevation_likelihood * azimuth_likelihood
    return (posterior / posterior.sum()).flatten()


def unseen_side(azimuths: Sequence[float], highest: float) -> Side | None:
    """Return a side of the object that neither photos nor their mirror images show: back, front, left, or the top.

    Args:
        azimuths: of the photos' cameras, rad.
        highest: elevation of the highest camera, rad.

    None if there is no such side, or no photo.

    Example:
        >>> around = math.pi / 4, -math.pi / 4
        >>> unseen_side((math.pi / 4,), 0.5), unseen_side(around, 0.5), unseen_side(around, 0.2), unseen_side((), 0.2)
        ('back', None, 'above', None)
    """
    if not azimuths:
        return None
    both = [*azimuths, *(2 * FRONT_AZIMUTH - azimuth for azimuth in azimuths)]
    sides: tuple[Side, ...] = "back", "front", "left"
    unseen = (side for side in sides if all(math.cos(SIDES[side] - angle) < math.cos(SEEN_ANGLE) for angle in both))
    return next(unseen, "above" if highest < _SEES_TOP else None)


def with_side(probability: Float[Tensor, "directions"], side: Side) -> Float[Tensor, "directions"]:
    """Combine the probabilities of directions with the side of the object that a person names.

    Sides are the object's own: its left is on the right of an image of its front. A prior, not a constraint: people
    confuse left and right, and name a view from a corner after either side.
    """
    azimuths, elevations = directions()
    if side == "above":
        likelihood = _gaussian(elevations - math.pi / 2, _SIDE_WIDTH)
    else:
        angle = torch.remainder(azimuths - SIDES[side] + math.pi, 2 * math.pi) - math.pi
        likelihood = _gaussian(angle, _SIDE_WIDTH)
    posterior = probability * torch.lerp(likelihood, torch.ones(()), _SIDE_WRONG)
    return posterior / posterior.sum()


def _gaussian(values: Float[Tensor, "*shape"], width: float) -> Float[Tensor, "*shape"]:
    return (-(values / width).square() / 2).exp()


def viewpoint_nll(
    probability: Float[Tensor, "directions"], azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """Return the negative log-likelihood of cameras (rad), relative to the likeliest direction: at least 0."""
    smooth = direction_weights(*directions()) @ probability
    return (smooth.max() / (direction_weights(azimuth, elevation) @ probability)).log().clamp_min(0)
