"""The soft shadow under an object: the fraction of the sky, brightest overhead, that it hides from the ground.

The shadow belongs to the background. Seen from above, the ground lies behind the whole object, so an image with opacity
is composited over the shadow like over any background. Seen from below, there is no ground.
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

_STRENGTH = 0.7  # fraction of the ground's light lost where no sky is visible
_OVERHEAD = 3  # 1: a uniform sky; more: brighter overhead, so that the shadow lies below the object
_COARSE = 2  # grid corners along each side of a ground texel
_SLABS = (0, 1, 2, 4, 8, 16, 32, 64)
"""Boundaries of slabs, in layers above the ground; thicker further up, where the height matters less."""
_MIN_CORNERS = 4  # a layer with at most this many solid corners is a speck, not the object's lowest layer


@dataclass(frozen=True, eq=False)
class GroundShadow:
    """A map of the ground, twice as long and wide as the scene's box. Not modified after creation."""

    darkness: UInt8[np.ndarray, "y x"]  # 255: all light is lost
    reach: tuple[float, float]  # scene units from the map's middle to its sides, along x and y
    height: float  # z of the ground

    def seen_by(self, camera: Camera) -> Float[Tensor, "height width"]:
        """Return the fraction (0..1) of the ground's light that each pixel loses; 0 where no ground is visible."""
        rays = camera_rays(camera, torch.ones(3))
        along = (self.height - rays.origins[..., 2]) / rays.directions[..., 2]
        place = (rays.origins + along[..., None] * rays.directions)[..., :2] / torch.tensor(self.reach)
        texels = torch.from_numpy(self.darkness).float()[None, None] / 255
        found = functional.grid_sample(texels, place.nan_to_num(9.0)[None].clamp(-9, 9), align_corners=False)[0, 0]
        return found * ((along > 0) & (rays.origins[..., 2] > self.height))


def cast_shadow(solid: Bool[Tensor, "x y z"], extent: tuple[float, float, float]) -> GroundShadow | None:
    """Compute the shadow on the ground, which is just below the lowest solid layer; None if no layer is solid.

    Args:
        solid: corners inside the object, of a grid over the scene's box.
        extent: half the size of the scene's box, scene units.
    """
    layers = solid.sum((0, 1)) > _MIN_CORNERS
    if not bool(layers.any()):
        return None
    first = int(layers.int().argmax())
    slabs = torch.stack([solid[..., first + begin : first + end].any(-1).float() for begin, end in pairwise(_SLABS)])
    slabs = functional.avg_pool2d(functional.pad(slabs, (0, 1, 0, 1)), _COARSE)
    cells = slabs.shape[-1] - 1
    spread = torch.fft.irfft2(torch.fft.rfft2(slabs, s=(3 * cells, 3 * cells)) * _kernels(extent, cells))
    hidden = spread[:, : 2 * cells, : 2 * cells].amax(0)  # the maximum over slabs, not their sum
    fade = (2 * (1 - torch.linspace(-1, 1, 2 * cells).abs())).clamp(0, 1)
    darkness = 255 * (_STRENGTH * fade[:, None] * fade * hidden).clamp(0, 1)
    height = extent[2] * (2 * (first - 0.5) / (len(solid) - 1) - 1)  # between this layer and the empty one below
    return GroundShadow((darkness.T + 0.5).to(torch.uint8).numpy(), (2 * extent[0], 2 * extent[1]), height)


@lru_cache(maxsize=2)
def _kernels(extent: tuple[float, float, float], cells: int) -> Complex[Tensor, "slabs x y"]:
    """Return, for each slab, the Fourier transform of the sky fraction that a corner hides from ground texels."""
    x, y, z = (2 * side / cells for side in extent)
    steps = torch.arange(3 * cells)
    # From a grid corner to a texel's middle; steps beyond the map wrap around.
    steps = torch.where(steps < 2 * cells, steps, steps - 3 * cells) - cells / 2 + 0.25
    square = (steps * x)[:, None] ** 2 + (steps * y) ** 2
    kernels = []
    for begin, end in pairwise(_SLABS):
        height = z / _COARSE * (begin + end) / 2
        kernel = x * y * _OVERHEAD / math.pi * height ** (2 * _OVERHEAD) / (square + height**2) ** (_OVERHEAD + 1)
        kernels.append(torch.fft.rfft2(kernel / kernel.sum().clamp_min(1.0)))
    return torch.stack(kernels)
