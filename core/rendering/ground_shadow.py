"""The shadow under an object: the fraction of the sky, brightest overhead, that it hides from the ground.

Where the object touches the ground, a narrow and dark contact shadow is added: the grid of the sky's part is too coarse
to show it.

The shadow belongs to the background. Seen from above, the ground lies behind the whole object, so an image with opacity
is composited over the shadow like over any background. Seen from below, there is no ground.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera, Factors
from core.geometry.rays import camera_rays

_OVERHEAD = 3  # 1: a uniform sky; more: brighter overhead, so that the shadow lies below the object
_COARSE = 2  # grid corners along each side of a texel of the sky's part
_FINE = 4  # texels of the map along each side of one of the sky's part
_CONTACT = 0.85  # fraction of the ground's light lost where the object touches it
_CONTACT_WIDTHS = (0.008, 0.013, 0.02)
"""Standard deviations of the contact shadow, scene units, of the lowest layers of corners from the ground up."""
_CONTACT_FALL = 0.75  # darkness of the contact shadow of a layer, relative to that of the layer below
_SLABS = (0, 1, 2, 4, 8, 16, 32, 64)
"""Boundaries of slabs, in layers above the ground; thicker further up, where the height matters less."""
_STRENGTHS = (0.9, 0.9, 0.9, 0.86, 0.7, 0.45, 0.3)
"""Fractions of the ground's light lost where a slab hides all sky: a seat leaves no dark disc between the legs."""
_LOWEST = 0.1  # fraction of the lowest layer's columns that may end below the ground
_MIN_CORNERS = 4  # a layer with at most this many solid corners is a speck, not the object's lowest layer


@dataclass(frozen=True, eq=False)
class GroundShadow:
    """A map of the ground, twice as long and wide as the scene's box. Not modified after creation."""

    darkness: UInt8[np.ndarray, "y x"]  # 255: all light is lost
    reach: tuple[float, float]  # scene units from the map's middle to its sides, along x and y
    height: float  # z of the ground

    def stretched(self, factors: Factors | None) -> "GroundShadow":
        """Return the shadow of the object stretched along the axes."""
        if factors is None:
            return self
        reach = self.reach[0] * factors[0], self.reach[1] * factors[1]
        return replace(self, reach=reach, height=self.height * factors[2])

    def seen_by(self, camera: Camera) -> Float[Tensor, "height width"]:
        """Return the fraction (0..1) of the ground's light that each pixel loses; 0 where no ground is visible."""
        rays = camera_rays(camera, torch.ones(3))
        distance = (self.height - rays.origins[..., 2]) / rays.directions[..., 2]
        uv = (rays.origins + distance[..., None] * rays.directions)[..., :2] / torch.tensor(self.reach)
        texels = torch.from_numpy(self.darkness).float()[None, None] / 255
        darkness = functional.grid_sample(texels, uv.nan_to_num(9.0)[None].clamp(-9, 9), align_corners=False)[0, 0]
        return darkness * ((distance > 0) & (rays.origins[..., 2] > self.height))


def cast_shadow(density: Float[Tensor, "x y z"], extent: tuple[float, float, float]) -> GroundShadow | None:
    """Compute the shadow on the ground, on which the object stands; None if no layer is solid.

    Args:
        density: at the corners of a grid over the scene's box, relative to the least one of a corner in the object.
        extent: half the size of the scene's box, scene units.
    """
    solid = density > 1
    layers = solid.sum((0, 1)) > _MIN_CORNERS
    if not bool(layers.any()):
        return None
    first = int(layers.int().argmax())
    sky = _hidden_sky(solid, first, extent)
    sky = functional.interpolate(sky[None, None], scale_factor=_FINE, mode="bilinear")[0, 0]
    darkness = 255 * (1 - (1 - sky) * (1 - _contact(density, first, extent)))
    height = extent[2] * (2 * _ground_layer(density, first) / (len(solid) - 1) - 1)
    return GroundShadow((darkness.T + 0.5).to(torch.uint8).numpy(), (2 * extent[0], 2 * extent[1]), height)


def _ground_layer(density: Float[Tensor, "x y z"], first: int) -> float:
    """Return the height of the ground in layers: where columns of the lowest solid layer reach the object's density."""
    if not first:
        return 0.0
    logs = density[..., first - 1 : first + 1].clamp(1e-6, 1e6).log()
    below, above = logs[density[..., first] > 1].unbind(-1)
    below = below.clamp(max=-1e-3)  # a column that goes on below is a speck there
    return first - 1 + float((below / (below - above)).quantile(_LOWEST))


def _contact(density: Float[Tensor, "x y z"], first: int, extent: tuple[float, float, float]) -> Float[Tensor, "u v"]:
    """Return the fraction (0..1) of the light that the lowest layers of the object take from the ground beside them."""
    corners = len(density) - 1
    texels = 2 * corners * _FINE // _COARSE
    lost = torch.zeros(texels, texels)
    steps = 2 * (torch.arange(texels) + 0.5) / texels - 1  # -1..1 along the map, which is twice as long as the grid
    for number, width in enumerate(_CONTACT_WIDTHS[: len(density) - first]):
        blurs = []
        for side in extent[:2]:
            away = 2 * side * (steps[:, None] - torch.linspace(-0.5, 0.5, corners + 1))
            step = 2 * side / corners
            blurs.append(step / (width * math.sqrt(2 * math.pi)) * torch.exp(-0.5 * (away / width) ** 2))
        layer = (2 * density[..., first + number] - 1).clamp(0, 1)  # none of haze
        lost = torch.maximum(lost, _CONTACT_FALL**number * (blurs[0] @ layer @ blurs[1].T).clamp(0, 1))
    return _CONTACT * lost


def _hidden_sky(solid: Bool[Tensor, "x y z"], first: int, extent: tuple[float, float, float]) -> Float[Tensor, "u v"]:
    """Return the fraction (0..1) of the ground's light that the object, from its layer ``first`` up, hides."""
    slabs = torch.stack([solid[..., first + begin : first + end].any(-1).float() for begin, end in pairwise(_SLABS)])
    slabs = functional.avg_pool2d(functional.pad(slabs, (0, 1, 0, 1)), _COARSE)
    cells = slabs.shape[-1] - 1
    spread = torch.fft.irfft2(torch.fft.rfft2(slabs, s=(3 * cells, 3 * cells)) * _kernels(extent, cells))
    strengths = torch.tensor(_STRENGTHS)[:, None, None]
    hidden = (strengths * spread[:, : 2 * cells, : 2 * cells]).amax(0)  # the maximum over slabs, not their sum
    fade = (2 * (1 - torch.linspace(-1, 1, 2 * cells).abs())).clamp(0, 1)
    return (fade[:, None] * fade * hidden).clamp(0, 1)


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
