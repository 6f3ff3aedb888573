"""The soft shadow under an object: how much of an even sky it hides from the ground that it stands on.

A part of pictures, never of the object: the ground is behind all of it for a camera above, so an image with opacity is
laid over the shadow as over any other background. From below there is no ground.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays

_STRENGTH = 0.7  # of the ground's light that it loses where it sees no sky
_OVERHEAD = 3
"""1: a sky that is as bright everywhere; more: brightest overhead, so that shadows lie under what casts them"""
_COARSE = 2  # corners along each side of what is one texel of the ground
_SLABS = (0, 1, 2, 4, 8, 16, 32, 64)
"""Layers above the ground where slabs begin, and end: the higher, the less their height matters."""
_MIN_CORNERS = 4  # that are solid in the layer that stands on the ground; no more are a speck


@dataclass(frozen=True, eq=False)
class GroundShadow:
    """A map of the ground, twice as long and wide as the scene's box. Never written again."""

    darkness: UInt8[np.ndarray, "y x"]  # 255: all light is lost
    reach: tuple[float, float]  # scene units from the middle of the map to its sides, along x and y
    height: float  # of the ground: its z

    def seen_by(self, camera: Camera, pixel_offset: float = 0.0) -> Float[Tensor, "height width"]:
        """The share of the ground's light (0..1) that is lost in each pixel; 0 where no ground is seen."""
        rays = camera_rays(camera, torch.ones(3), pixel_offset)
        along = (self.height - rays.origins[..., 2]) / rays.directions[..., 2]
        place = (rays.origins + along[..., None] * rays.directions)[..., :2] / torch.tensor(self.reach)
        texels = torch.from_numpy(self.darkness).float()[None, None] / 255
        found = functional.grid_sample(texels, place.nan_to_num(9.0)[None].clamp(-9, 9), align_corners=False)[0, 0]
        return found * ((along > 0) & (rays.origins[..., 2] > self.height))


def cast_shadow(solid: Bool[Tensor, "x y z"], extent: tuple[float, float, float]) -> GroundShadow | None:
    """The shadow on the lowest layer of solid corners; None where there is none.

    Args:
        solid: of the corners of the scene's grid.
        extent: half the size of the scene's box.
    """
    layers = solid.sum((0, 1)) > _MIN_CORNERS
    if not bool(layers.any()):
        return None
    first = int(layers.int().argmax())
    slabs = torch.stack([solid[..., first + begin : first + end].any(-1).float() for begin, end in pairwise(_SLABS)])
    slabs = functional.avg_pool2d(functional.pad(slabs, (0, 1, 0, 1)), _COARSE)
    cells = slabs.shape[-1] - 1
    spread = torch.fft.irfft2(torch.fft.rfft2(slabs, s=(3 * cells, 3 * cells)) * _kernels(extent, cells))
    hidden = spread[:, : 2 * cells, : 2 * cells].amax(0)  # of what slabs hide together, the most that one does
    fade = (2 * (1 - torch.linspace(-1, 1, 2 * cells).abs())).clamp(0, 1)
    darkness = 255 * (_STRENGTH * fade[:, None] * fade * hidden).clamp(0, 1)
    height = extent[2] * (2 * (first - 0.5) / (len(solid) - 1) - 1)  # between this layer and the empty one below
    return GroundShadow((darkness.T + 0.5).to(torch.uint8).numpy(), (2 * extent[0], 2 * extent[1]), height)


@lru_cache(maxsize=2)
def _kernels(extent: tuple[float, float, float], cells: int) -> Complex[Tensor, "slabs x y"]:
    """For each slab, what a corner of it hides of the sky over each texel of the ground, to be multiplied with."""
    x, y, z = (2 * side / cells for side in extent)
    steps = torch.arange(3 * cells)
    # Of a texel's middle from a corner of the grid; the steps after the map's are those backwards.
    steps = torch.where(steps < 2 * cells, steps, steps - 3 * cells) - cells / 2 + 0.25
    square = (steps * x)[:, None] ** 2 + (steps * y) ** 2
    kernels = []
    for begin, end in pairwise(_SLABS):
        height = z / _COARSE * (begin + end) / 2
        kernel = x * y * _OVERHEAD / math.pi * height ** (2 * _OVERHEAD) / (square + height**2) ** (_OVERHEAD + 1)
        kernels.append(torch.fft.rfft2(kernel / kernel.sum().clamp_min(1.0)))
    return torch.stack(kernels)
