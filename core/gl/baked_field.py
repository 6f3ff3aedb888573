"""An object's field as a 3D texture, drawn by OpenGL (:mod:`core.gl.baked_shader`).

The texture stores logits (before softplus and contrast). Interpolating logits linearly is 3 to 6 dB better than
interpolating density, and edges stay crisp on coarse grids. :mod:`core.gl.baking` fills the texture.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn import functional

from core.detail.lookup import DetailMaps
from core.geometry.camera import Camera
from core.geometry.rays import Rays, camera_rays, ray_points
from core.models.density import logits_to_density
from core.models.field_config import FieldConfig
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.ground_shadow import GroundShadow
from core.rendering.occupancy import CELLS
from core.rendering.reference import Rendered

LOGITS = -8.0, 24.0  # logits that bytes 0 and 255 stand for; -8 is a density of 0.01 per scene unit
STEPS_PER_TEXEL = 1.5  # samples of a ray; crisp densities lose 3 dB with 0.7, and more adds nothing
MIN_LIGHT = 0.005  # fraction of its light below which a ray ends; the rest counts as absorbed
_MAX_DISTANCE = 8  # largest distance stored, so the most cells that a ray skips at a time
_CHUNK_RAYS = 4096


@dataclass(frozen=True, eq=False)
class BakedField:
    """Colour and density at the corners of a grid, and its occupied cells. Not modified after creation."""

    texels: UInt8[np.ndarray, "x y z 4"]
    """rgb, and the logit of density as a byte (:data:`LOGITS`); only the occupied part of the grid"""
    distance: UInt8[np.ndarray, "cells cells cells"]
    """for each occupancy cell, the distance from :func:`cell_distances`; 0: the cell is occupied"""
    extent: tuple[float, float, float]  # half the size of the scene's box, scene units
    config: FieldConfig  # of the field: how density follows from logits
    pixel_offset: float  # px, shift of rays to the left and up of pixel centres
    cells: int  # cells of the texel grid along each axis of the box; the outermost corners lie on the box's faces
    first: tuple[int, int, int] = (0, 0, 0)  # grid corner of the first texel
    detail: DetailMaps | None = None  # photo detail, evaluated per pixel since it is far finer than texels
    shadow: GroundShadow | None = None  # the object's shadow on the ground, to be drawn over a background

    @property
    def step(self) -> float:
        """Distance between the samples of a ray, scene units."""
        return 2 * max(self.extent) / (STEPS_PER_TEXEL * self.cells)


def colour_texels(colour: Float[Tensor, "*corners 3"]) -> UInt8[Tensor, "*corners 3"]:
    """Convert colours to bytes, clamped to 0..1."""
    return (255 * colour.clamp(0, 1) + 0.5).to(torch.uint8)


def logit_texels(logits: Float[Tensor, "*corners"]) -> UInt8[Tensor, "*corners"]:
    """Convert logits to bytes, clamped to :data:`LOGITS`."""
    least, most = LOGITS
    return (255 * ((logits - least) / (most - least)).clamp(0, 1) + 0.5).to(torch.uint8)


def cell_distances(cells: Bool[Tensor, "x y z"]) -> UInt8[np.ndarray, "x y z"]:
    """Return the distance from each cell to the nearest occupied cell: cells in the maximum norm, at most 8."""
    distance = torch.zeros_like(cells, dtype=torch.uint8)
    reached = cells.clone()
    for _ in range(_MAX_DISTANCE):
        distance += ~reached
        for axis in range(3):
            along = reached.movedim(axis, 0)
            before = along.clone()
            along[1:] |= before[:-1]
            along[:-1] |= before[1:]
    return distance.cpu().numpy()


@torch.no_grad()
def render_baked(baked: BakedField, camera: Camera) -> Rendered:
    """Render a baked field like :mod:`core.gl.baked_shader`, but on the processor, on white, without shadow."""
    extent = torch.tensor(baked.extent)
    rays = camera_rays(camera, extent, baked.pixel_offset)
    lines = max(1, _CHUNK_RAYS // camera.width)
    bands = [rays[first : first + lines] for first in range(0, camera.height, lines)]
    texels = torch.from_numpy(baked.texels).float().movedim(-1, 0)[None] / 255
    rendered = Rendered.joined(_march(band, baked, texels) for band in bands)
    return baked.detail.added(rendered, camera)[0] if baked.detail else rendered


def _march(rays: Rays, baked: BakedField, texels: Float[Tensor, "1 4 x y z"]) -> Rendered:
    """Render rays through the occupied cells of a baked field; ``texels`` are its texels, 0..1."""
    extent = torch.tensor(baked.extent)
    count = max(1, math.ceil(float((rays.far - rays.near).max()) / baked.step))
    depths = rays.near[..., None] + (torch.arange(count) + 0.5) * baked.step
    place = ray_points(rays, depths) / extent
    cell = ((place + 1) * (CELLS / 2)).long().clamp(0, CELLS - 1)
    occupied = (depths < rays.far[..., None]) & torch.from_numpy(baked.distance == 0)[cell.unbind(-1)]
    corner = (place[occupied] + 1) * (baked.cells / 2) - torch.tensor(baked.first)
    within = 2 * corner / (torch.tensor(baked.texels.shape[:3]) - 1) - 1
    samples = torch.zeros(*depths.shape, 4)
    samples[occupied] = functional.grid_sample(
        texels, within.flip(-1)[None, None, None], padding_mode="border", align_corners=True
    )[0, :, 0, 0].T
    logit = LOGITS[0] + (LOGITS[1] - LOGITS[0]) * samples[..., 3]
    density = occupied * logits_to_density(logit, baked.config)
    edges = functional.pad(depths + baked.step / 2, (1, 0))
    edges[..., 0] = rays.near
    weights, left = compositing_weights(density, edges)
    depth = (weights * depths).sum(-1) / (1 - left).clamp_min(1e-6)
    return Rendered(composite_on_white(weights, left, samples[..., :3]), depth * (left < 1), 1 - left)
