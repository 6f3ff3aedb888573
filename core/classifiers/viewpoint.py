"""The viewpoint classifier: a small network that predicts from which direction an image shows an object.

Silhouettes of a few prototypes, which is all that :mod:`core.photos.view_bank` has, are similar from many sides where
a new object differs from all of them. This network is trained on every training image in many augmentations, and
recognises a front. It says nothing about codes: it is a prior on the camera's direction, on a grid.
"""

import math
from functools import lru_cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.classifiers.crops import CropClassifier, crop_to_object
from core.geometry.camera import camera_rotation

AZIMUTHS = 24
ELEVATIONS = (-25.0, -5.0, 10.0, 25.0, 40.0, 58.0, 78.0)
"""degrees. Near the pole the azimuth is the roll of the image, so every elevation has all azimuths."""
_DIRECTIONS = AZIMUTHS * len(ELEVATIONS)
_UNIFORM_MIX = 0.05
"""Share of the uniform distribution in every prediction: how often the network is confident and wrong."""
_KERNEL_WIDTH = math.radians(12)  # A direction between those of the grid has the probability of those that are so near.
_WITNESS_RIGHT, _WITNESS_MIRRORED, _WITNESS_WRONG = 0.66, 0.23, 0.11
_WITNESS_WIDTH = math.radians(15)
"""How often Objectron's azimuth is right, its mirror image is, or neither: of renders of validation and foreign chairs.
"""
_WITNESS_ALONE = 0.25
"""Share of the result in which the classifier tells the elevation only; from 0 to 0.25 the likelihood of 27 composites
of validation chairs is the same, and that of other renders falls by 0.07.
"""


class ViewpointClassifier(CropClassifier):
    """A classifier whose classes are the directions of :func:`directions`."""

    def __init__(self) -> None:
        super().__init__(_DIRECTIONS)


@lru_cache(maxsize=1)
def directions() -> tuple[Float[Tensor, "directions"], Float[Tensor, "directions"]]:
    """Azimuths and elevations of the grid (rad), elevation by elevation; not to be written to."""
    elevation, azimuth = torch.meshgrid(
        torch.tensor(ELEVATIONS).deg2rad(), torch.arange(AZIMUTHS) * (2 * math.pi / AZIMUTHS), indexing="ij"
    )
    return azimuth.flatten(), elevation.flatten()


def direction_weights(
    azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"], width: float = _KERNEL_WIDTH
) -> Float[Tensor, "*batch directions"]:
    """How near cameras (rad) are to the directions of the grid: weights that add up to 1, a Gaussian of ``width``."""
    turned = camera_rotation(azimuth, elevation).flatten(-2) @ camera_rotation(*directions()).flatten(-2).T
    angle = ((turned - 1) / 2).clamp(-1, 1).acos()
    return (-(angle / width).square() / 2).softmax(-1)


@torch.no_grad()
def predict_viewpoint(
    classifier: ViewpointClassifier, pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "directions"]:
    """The probability of every direction of the grid for one image; they add up to 1.

    Args:
        pixels: 0..1.
        mask: True on the object; anything on it at all.
    """
    return torch.lerp(
        classifier(crop_to_object(pixels, mask)[None])[0].softmax(-1), torch.tensor(1 / _DIRECTIONS), _UNIFORM_MIX
    )


def with_witness(
    probability: Float[Tensor, "directions"], azimuth: float, elevation: float
) -> Float[Tensor, "directions"]:
    """Return the probabilities of directions given the one (rad) that a second witness tells.

    The witness may mistake front and back for each other (-azimuth), or be wrong altogether. The classifier may be sure
    and wrong, so a share of the result takes the azimuth from the witness alone.
    """
    azimuths, elevations = directions()[0][:AZIMUTHS], directions()[1][::AZIMUTHS]
    likelihood = torch.full((AZIMUTHS,), _WITNESS_WRONG / AZIMUTHS)
    for told, share in ((azimuth, _WITNESS_RIGHT), (-azimuth, _WITNESS_MIRRORED)):
        apart = torch.remainder(azimuths - told + math.pi, 2 * math.pi) - math.pi
        near = _gaussian(apart, _WITNESS_WIDTH)
        likelihood += share * near / near.sum()
    near = (1 - _WITNESS_WRONG) * _gaussian(elevations - elevation, _WITNESS_WIDTH) + _WITNESS_WRONG
    by_elevation = probability.reshape(-1, AZIMUTHS) * near[:, None]
    by_elevation = by_elevation / by_elevation.sum()
    both = by_elevation * likelihood / (by_elevation * likelihood).sum()
    return torch.lerp(both, by_elevation.sum(1, keepdim=True) * likelihood, _WITNESS_ALONE).flatten()


def _gaussian(values: Float[Tensor, "*shape"], width: float) -> Float[Tensor, "*shape"]:
    return (-(values / width).square() / 2).exp()


def viewpoint_nll(
    probability: Float[Tensor, "directions"], azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """The negative log-likelihood of cameras (rad), relative to the likeliest one: at least 0."""
    smooth = direction_weights(*directions()) @ probability
    return (smooth.max() / (direction_weights(azimuth, elevation) @ probability)).log().clamp_min(0)
