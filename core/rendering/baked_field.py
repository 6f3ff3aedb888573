"""An object's field baked into a 3D texture, for OpenGL to draw (:mod:`core.rendering.baked_shader`).

Of density, its logit is stored (what the network gives before its softplus): linear interpolation of that is 3
to 6 dB better than of density itself. Of colour, the mean over a few directions is: what the view changes of it costs 3
to 6 dB, and one texture serves all views. Only corners of occupied cells are evaluated; the others are never read.
"""

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays, ray_points
from core.models.cells import corners_of, divide, unravelled
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.detail_maps import DetailMaps
from core.rendering.fast import shape_occupancy
from core.rendering.folded_field import FoldedField
from core.rendering.ground_shadow import GroundShadow
from core.rendering.occupancy import CELLS
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, Kind

LOGITS = -8.0, 24.0
"""Logits that 0 and 255 stand for; the least is a density of 0.01 per scene unit."""
STEPS_PER_TEXEL = 1.5
MAX_STEPS = 128
"""along the longest side of the box: more change nothing that can be seen"""
MIN_LIGHT = 0.002
"""A ray ends where less of its light is left."""
_DIVISIONS = (1, 2)
"""of the edges of an occupied cell, from coarse to fine"""
_FARTHEST = 8
"""cells that are skipped at a time, at most"""
_BLOCK = 8192
"""Corners evaluated at a time: what a newer job waits for."""
_ELEVATION = math.radians(20)
_DIRECTIONS = tuple(
    (-math.cos(_ELEVATION) * math.cos(turn), -math.cos(_ELEVATION) * math.sin(turn), -math.sin(_ELEVATION))
    for turn in (math.pi / 4 + side * math.pi / 2 for side in range(4))
)
"""that colours are averaged over: from all sides, a little from above"""
_CHUNK_RAYS = 4096


@dataclass(frozen=True, eq=False)
class BakedField:
    """Colour and density at the corners of a grid, and which of its cells hold anything. Never written again."""

    texels: UInt8[np.ndarray, "x y z 4"]
    """rgb, and the logit of density on the scale of :data:`LOGITS`; of the part of the grid that is occupied"""
    distance: UInt8[np.ndarray, "cells cells cells"]
    """cells to the nearest occupied one, diagonals as long as edges; 0: occupied"""
    extent: tuple[float, float, float]
    """half the size of the scene's box, scene units"""
    density_scale: float
    pixel_offset: float
    """px, by how much rays pass left of and above pixel centres"""
    cells: int
    """of the grid, along each axis of the box; the first and the last corners lie on the box's faces"""
    first: tuple[int, int, int] = (0, 0, 0)
    """the corner of the grid that the first texel is of"""
    detail: DetailMaps | None = None
    """what a photo adds to the colours: far finer than texels, so it is looked up for each pixel"""
    shadow: GroundShadow | None = None
    """of the object on the ground, to be laid between it and a background"""

    @property
    def step(self) -> float:
        """scene units between the samples of a ray"""
        return 2 * max(self.extent) / min(MAX_STEPS, STEPS_PER_TEXEL * self.cells)


def bake(model: Model, codes: Codes) -> Iterator[BakedField | None]:
    """Bake an object: 64 cells along each axis, then 128; None after every few thousand corners between.

    What the texture does not change is kept while memory is free: another texture of a shape bakes colours only.
    """
    with torch.inference_mode():
        folded = FoldedField(model, codes)
        occupancy = shape_occupancy(model, tuple(codes.shape.tolist()))
        cells = occupancy.cells
        distance = cell_distances(cells)
    for divisions in _DIVISIONS:
        texels = np.zeros(((CELLS * divisions + 1) ** 3, 4), np.uint8)
        for block in _blocks(model, folded, codes, cells, divisions):
            with torch.inference_mode():
                texels[block.corner.cpu().numpy()] = _texels(folded, block).cpu().numpy()
            yield None
        shaped, count = texels.reshape(*(CELLS * divisions + 1,) * 3, 4), CELLS * divisions
        about = model.extent, model.field.config.density_scale, model.pixel_offset, count
        yield BakedField(shaped, distance, *about, shadow=occupancy.shadow)


class _Block(NamedTuple):
    """Corners, and what of them no texture changes."""

    corner: Int[Tensor, "corners"]
    density: Float[Tensor, "corners"]
    features: Float[Tensor, "corners width"]


def _blocks(
    model: Model, folded: FoldedField, codes: Codes, cells: Bool[Tensor, "x y z"], divisions: int
) -> Generator[_Block, None, None]:
    """The corners of the occupied cells, each divided; kept where there is room for it beside all else."""
    key = model, tuple(codes.shape.tolist()), divisions
    known: Sequence[_Block] | None = CACHE.get(Kind.VIEW, key)
    if known is not None:
        yield from known
        return
    found = list[_Block]()
    with torch.inference_mode():
        corners = cell_corners(cells, divisions)
        scale = 2 * model.extent_tensor / (CELLS * divisions)
    for part in corners.split(_BLOCK):
        with torch.inference_mode():
            points = unravelled(part, CELLS * divisions + 1) * scale
            found.append(_Block(part, *folded.density(folded.first_layer(points - model.extent_tensor))))
        yield found[-1]
    size = sum(part.nbytes for block in found for part in block)
    if size <= CACHE.limit - CACHE.used:
        CACHE.put(Kind.VIEW, key, found, size)


def cell_corners(cells: Bool[Tensor, "x y z"], divisions: int) -> Int[Tensor, "corners"]:
    """The indices of all corners of these cells, each divided, row by row."""
    return corners_of(divide(cells, divisions)).flatten().nonzero()[:, 0]


def _texels(folded: FoldedField, block: _Block) -> UInt8[Tensor, "corners 4"]:
    towards = folded.direction_bias(torch.tensor(_DIRECTIONS, device=folded.device))
    seen = [folded.colour(block.features, bias.expand(len(block.features), -1)) for bias in towards]
    logit = logit_texels(block.density, folded.field.config.density_scale)
    return torch.cat((colour_texels(torch.stack(seen).mean(0)), logit[:, None]), -1)


def colour_texels(colour: Float[Tensor, "*corners 3"]) -> UInt8[Tensor, "*corners 3"]:
    """Colours in 0..1 as texels hold them."""
    return (255 * colour.clamp(0, 1) + 0.5).to(torch.uint8)


def logit_texels(density: Float[Tensor, "*corners"], scale: float) -> UInt8[Tensor, "*corners"]:
    """Densities (per scene unit) as texels hold them: their logits, by the inverse of softplus."""
    least, most = LOGITS
    share = (density / scale).clamp_min(1e-6)
    logit = (share + torch.log(-torch.expm1(-share)) - least) / (most - least)
    return (255 * logit.nan_to_num(1.0).clamp(0, 1) + 0.5).to(torch.uint8)


def cell_distances(cells: Bool[Tensor, "x y z"]) -> UInt8[np.ndarray, "x y z"]:
    """Cells from each to the nearest of these, diagonals as long as edges, up to a few."""
    distance, reached = torch.zeros_like(cells, dtype=torch.uint8), cells.clone()
    for _ in range(_FARTHEST):
        distance += ~reached
        for axis in range(3):
            along = reached.movedim(axis, 0)
            before = along.clone()
            along[1:] |= before[:-1]
            along[:-1] |= before[1:]
    return distance.cpu().numpy()


@torch.no_grad()
def render_baked(baked: BakedField, camera: Camera) -> Rendered:
    """The image that OpenGL draws of it, slowly: samples at equal steps from where a ray enters the box, on white."""
    extent = torch.tensor(baked.extent)
    rays = camera_rays(camera, extent, baked.pixel_offset)
    texels = torch.from_numpy(baked.texels).float().movedim(-1, 0)[None] / 255
    occupied = torch.from_numpy(baked.distance == 0)
    rows = max(1, _CHUNK_RAYS // camera.width)
    parts = []
    for row in range(0, camera.height, rows):
        some = rays[row : row + rows]
        count = max(1, math.ceil(float((some.far - some.near).max()) / baked.step))
        depths = some.near[..., None] + (torch.arange(count) + 0.5) * baked.step
        place = ray_points(some, depths) / extent
        cell = ((place + 1) * (CELLS / 2)).long().clamp(0, CELLS - 1)
        there = (depths < some.far[..., None]) & occupied[cell.unbind(-1)]
        found = torch.zeros(*depths.shape, 4)
        corner = (place[there] + 1) * (baked.cells / 2) - torch.tensor(baked.first)
        within = 2 * corner / (torch.tensor(baked.texels.shape[:3]) - 1) - 1
        found[there] = functional.grid_sample(
            texels, within.flip(-1)[None, None, None], padding_mode="border", align_corners=True
        )[0, :, 0, 0].T
        logit = LOGITS[0] + (LOGITS[1] - LOGITS[0]) * found[..., 3]
        density = there * baked.density_scale * functional.softplus(logit)
        edges = functional.pad(depths + baked.step / 2, (1, 0))
        edges[..., 0] = some.near
        weights, left = compositing_weights(density, edges)
        depth = (weights * depths).sum(-1) / (1 - left).clamp_min(1e-6)
        parts.append((composite_on_white(weights, left, found[..., :3]), depth * (left < 1), 1 - left))
    rendered = Rendered(*(torch.cat(part) for part in zip(*parts, strict=True)))
    return baked.detail.added(rendered, camera)[0] if baked.detail else rendered
