"""A glance at a picture: from which directions an object is probably seen, told by a small network.

Silhouettes of a few prototypes, which is all that the bank of :mod:`core.photos.view_bank` knows, look alike from many
sides where a new object looks like none of them. This network has seen every training picture in many disguises, and
has learnt what a front is. It says nothing about codes: it is a prior on the camera's direction, on a grid.
"""

import math
from functools import lru_cache
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from core.geometry.camera import camera_rotation

AZIMUTHS = 24
ELEVATIONS = (-25.0, -5.0, 10.0, 25.0, 40.0, 58.0, 78.0)
"""degrees. Near the pole the azimuth is the roll of the picture, so every elevation has all azimuths."""
_DIRECTIONS = AZIMUTHS * len(ELEVATIONS)
_MISTAKEN = 0.05
"""How often it has no idea of a picture and does not know it."""
SIDE = 48
"""px, of what the network sees"""
_CHANNELS = (20, 40, 64, 80)
_FEW = 32
_HIDDEN = 96
_MARGIN = 1.12
"""of the square that it sees, over the longer side of the object's box"""
_BLUR = math.radians(12)
"""A direction between those of the grid has the probability of those that are so near."""


class Glance(nn.Module):
    """A convolutional network over (pictures, 4, SIDE, SIDE): rgb on white and the mask, 0..1, cut out by
    :func:`cropped`. It gives the logarithm of the odds of every direction of :func:`directions`.
    """

    def __init__(self) -> None:
        super().__init__()
        sizes = (4, *_CHANNELS)
        self.layers = nn.ModuleList(nn.Conv2d(one, other, 3, 2, 1) for one, other in pairwise(sizes))
        self.fewer = nn.Conv2d(sizes[-1], _FEW, 1)
        self.hidden = nn.Linear(_FEW * (SIDE // 2 ** len(_CHANNELS)) ** 2, _HIDDEN)
        self.last = nn.Linear(_HIDDEN, _DIRECTIONS)

    def forward(self, pictures: Float[Tensor, "pictures 4 side side"]) -> Float[Tensor, "pictures directions"]:
        """Logarithms of the odds; dropout while training."""
        y = 2 * pictures - 1
        for layer in (*self.layers, self.fewer):
            y = layer(y).relu()
        y = self.hidden(y.flatten(1)).relu()
        return self.last(functional.dropout(y, 0.1, self.training))


@lru_cache(maxsize=1)
def directions() -> tuple[Float[Tensor, "directions"], Float[Tensor, "directions"]]:
    """Azimuths and elevations of the grid (rad), elevation by elevation; not to be written to."""
    elevation, azimuth = torch.meshgrid(
        torch.tensor(ELEVATIONS).deg2rad(), torch.arange(AZIMUTHS) * (2 * math.pi / AZIMUTHS), indexing="ij"
    )
    return azimuth.flatten(), elevation.flatten()


def nearness(
    azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"], blur: float = _BLUR
) -> Float[Tensor, "*batch directions"]:
    """How near cameras (rad) are to the directions of the grid: shares that add up to 1, a bell of width ``blur``."""
    turned = camera_rotation(azimuth, elevation).flatten(-2) @ camera_rotation(*directions()).flatten(-2).T
    angle = ((turned - 1) / 2).clamp(-1, 1).acos()
    return (-(angle / blur).square() / 2).softmax(-1)


@torch.no_grad()
def glanced(
    glance: Glance, pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "directions"]:
    """The probability of every direction for one picture; they add up to 1.

    Args:
        pixels: 0..1.
        mask: True on the object; anything on it at all.
    """
    return torch.lerp(glance(cropped(pixels, mask)[None])[0].softmax(-1), torch.tensor(1 / _DIRECTIONS), _MISTAKEN)


def surprise(
    probability: Float[Tensor, "directions"], azimuth: Float[Tensor, "*batch"], elevation: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """By how much less likely cameras (rad) are than the likeliest one: at least 0, a logarithm."""
    smooth = nearness(*directions()) @ probability
    return (smooth.max() / (nearness(azimuth, elevation) @ probability)).log().clamp_min(0)


def cropped(
    pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "4 side side"]:
    """What the network sees of a picture: the object on white and its mask, in a square around its box."""
    rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
    ends = torch.stack((rows[[0, -1]], columns[[0, -1]])) + torch.tensor([0, 1])
    middle, half = ends.float().mean(1), _MARGIN * float(ends.diff(dim=1).max()) / 2
    steps = (torch.arange(2 * SIDE) + 0.5) / SIDE - 1
    y, x = ((one + half * steps) / length * 2 - 1 for one, length in zip(middle, mask.shape, strict=True))
    grid = torch.stack(torch.broadcast_tensors(x[None, :], y[:, None]), -1)
    inside = mask[..., None].float()
    seen = torch.cat(((pixels - 1) * inside, inside), -1).movedim(-1, 0)[None]
    found = functional.avg_pool2d(functional.grid_sample(seen, grid[None], align_corners=False), 2)[0]
    return torch.cat((found[:3] + 1, found[3:]))
