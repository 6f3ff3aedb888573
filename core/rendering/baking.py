"""Baking of an object into a 3D texture: density once, colours averaged over directions or for single cameras.

Stored values are prefiltered, since linear interpolation of exact values is biased where a field curves: 2 to 6 dB
(:func:`prefilter`).

View dependence of colours limits a texture for all views to 35 to 40 dB from the exact render, however fine the grid.
For more accuracy, colours are evaluated for one camera at the corners it may see, and mixed between two cameras a few
degrees apart (:func:`mixed`).
"""

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.models.cells import corners_of, divide, unravelled
from core.models.codes import Codes
from core.models.density import density_to_logits
from core.models.model import Model
from core.rendering.baked_field import BakedField, cell_distances, colour_texels, logit_texels
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS, shape_occupancy
from core.rendering.outline import outline
from core.runtime.caches import CACHE, CacheKind
from core.runtime.pool import map_pieces

_DIVISIONS = (1, 2)  # of the edges of an occupied cell, from coarse to fine
_BLOCK = 4096  # corners that a thread evaluates at a time: the longest wait of a newer job
_ELEVATION = math.radians(20)
_DIRECTIONS = tuple(
    (-math.cos(_ELEVATION) * math.cos(turn), -math.cos(_ELEVATION) * math.sin(turn), -math.sin(_ELEVATION))
    for turn in (math.pi / 4 + side * math.pi / 2 for side in range(4))
)  # averaged over for colours: from all sides, a little from above
_MIN_DENSITY = 0.1
"""per scene unit: a cell with less at all corners absorbs under 0.2 % of the light and counts as empty"""
_BELOW = 12.0  # optical depth along every axis beyond which no camera sees a point
_BEHIND = 4.0  # optical depth in front of a point beyond which it is not coloured for a camera
_VOXEL = 2  # texels along each side of a voxel, the unit of the visibility test
_AHEAD, _LOOK = 2.0, 16  # voxels: start and number of the visibility test's steps towards the camera


class Box(NamedTuple):
    """A part of the grid of corners, ``end`` exclusive."""

    first: tuple[int, int, int]
    end: tuple[int, int, int]

    @property
    def sides(self) -> tuple[int, int, int]:
        """Corners along each axis."""
        x, y, z = (end - first for first, end in zip(*self, strict=True))
        return x, y, z


def box_of(occupied: Bool[Tensor, "x y z"], cells: int) -> Box:
    """Return the box of occupied cells (of the 64 per axis) in a grid of ``cells``; the whole grid if none is."""
    found = occupied.nonzero().cpu()
    low, high = (found.amin(0), found.amax(0) + 1) if len(found) else (torch.zeros(3), torch.full((3,), CELLS))
    scale = cells // CELLS
    first, end = ((scale * low).int().tolist(), (scale * high + 1).int().tolist())
    return Box((first[0], first[1], first[2]), (end[0], end[1], end[2]))


@dataclass(frozen=True, eq=False)
class BakedShape:
    """The baked values of an object that depend on neither texture nor camera."""

    field: BakedField  # without colours
    box: Box
    corners: Int[Tensor, "seen 3"]  # at the surface, so potentially visible; relative to the box's first corner
    neighbours: Int[Tensor, "seen 6"]
    """the two neighbours along each axis; the corner itself if one of the two is not at the surface"""
    features: Float[Tensor, "seen width"]  # input of the colour (density)
    hidden: Float[Tensor, "u v w"]  # optical depth of each voxel

    @property
    def size(self) -> int:
        """bytes"""
        parts = self.corners, self.neighbours, self.features, self.hidden
        return self.field.texels.nbytes + sum(part.nbytes for part in parts)

    def coloured(self, texels: UInt8[Tensor, "x y z 4"]) -> BakedField:
        """Return the field with these texels."""
        return replace(self.field, texels=texels.numpy())


def bake_shape(
    model: Model, folded: FoldedField, occupied: Bool[Tensor, "x y z"], cells: int, box: Box
) -> Generator[None, None, BakedShape]:
    """Evaluate densities in the occupied cells, and features at the surface; yields after every few thousand corners.

    Args:
        cells: of the grid, along each axis of the scene's box; a multiple of :data:`~core.rendering.occupancy.CELLS`.
        box: the stored part of the grid.
    """

    def evaluate(part: Int[Tensor, "corners 3"]) -> tuple[Tensor, Tensor]:
        with torch.inference_mode():
            return folded.density(_world(model.extent, cells, box, part).to(folded.device))

    density = torch.zeros(box.sides)
    at_corners = corners_of(divide(occupied, cells // CELLS)).flatten().nonzero()[:, 0].cpu()
    parts = (unravelled(at_corners, cells + 1) - torch.tensor(box.first)).split(_BLOCK)
    for part, values in zip(parts, map_pieces(lambda part: evaluate(part)[0].cpu(), parts), strict=True):
        density[part.unbind(-1)] = values
        yield
    thickness = density * (2 * max(model.extent) / cells)
    seen = _surface(density, thickness)
    corners, neighbours, features = seen.nonzero(), _neighbours(seen), list[Tensor]()
    for values in map_pieces(lambda part: evaluate(part)[1], corners.split(_BLOCK)):
        features.append(values)
        yield
    config = model.field.config
    logits = density_to_logits(density, config)
    logits[seen] = prefilter(logits[seen][:, None], neighbours)[:, 0]
    texels = torch.zeros(*box.sides, 4, dtype=torch.uint8)
    texels[..., 3] = logit_texels(logits)
    distance = cell_distances(_filled_cells(density, cells, box))
    field = BakedField(texels.numpy(), distance, model.extent, config, model.pixel_offset, cells, box.first)
    hidden = _VOXEL * functional.avg_pool3d(thickness[None], _VOXEL, ceil_mode=True)[0]
    return BakedShape(field, box, corners, neighbours, torch.cat(features), hidden)


def bake(model: Model, codes: Codes) -> Iterator[BakedField | None]:
    """Bake an object with mean colours over directions: 64 cells per axis, then 128; None many times between.

    The shape is cached while memory is free, so that another texture bakes colours only.
    """
    with torch.inference_mode():
        folded = FoldedField(model, codes)
        shape, bound = tuple(codes.shape.tolist()), outline(model, codes)
        occupancy = shape_occupancy(model, shape)
        towards = folded.direction_bias(torch.tensor(_DIRECTIONS, device=folded.device))
    for divisions in _DIVISIONS:
        cells, key = CELLS * divisions, (model, shape, bound, divisions)
        baked: BakedShape | None = CACHE.get(CacheKind.VIEW, key)
        if baked is None:
            baked = yield from bake_shape(model, folded, occupancy.cells, cells, box_of(occupancy.cells, cells))
            if baked.size <= CACHE.limit - CACHE.used:
                CACHE.put(CacheKind.VIEW, key, baked, baked.size)
        colours = list[Tensor]()
        for part in map_pieces(partial(_mean_colours, folded, towards), baked.features.split(_BLOCK)):
            colours.append(part)
            yield None
        texels = torch.from_numpy(baked.field.texels).clone()
        texels[..., :3][baked.corners.unbind(-1)] = colour_texels(prefilter(torch.cat(colours), baked.neighbours))
        yield replace(baked.coloured(texels), shadow=occupancy.shadow)


@torch.inference_mode()
def _mean_colours(
    folded: FoldedField, towards: Float[Tensor, "directions width"], features: Float[Tensor, "some width"]
) -> Float[Tensor, "some 3"]:
    seen = [folded.colour(features, bias.expand(len(features), -1)) for bias in towards]
    return torch.stack(seen).mean(0).cpu()


class ObjectViews:
    """A baked object with colours for one camera after another."""

    def __init__(self, model: Model, folded: FoldedField, shape: BakedShape) -> None:
        self._folded, self._shape, self._extent = folded, shape, torch.tensor(model.extent)
        self._colours: Float[Tensor, "seen 3"] | None = None
        self._newest = torch.from_numpy(shape.field.texels)
        self._shown = torch.zeros(shape.hidden.shape, dtype=torch.bool)
        self._shown[(shape.corners // _VOXEL).unbind(-1)] = True

    def seen_from(self, camera: Camera) -> Generator[None, None, BakedField]:
        """Bake the colours for a camera; yields after every few thousand corners.

        The first camera evaluates all corners; later ones keep the previous colours of corners they do not see.
        """
        shape, origin = self._shape, camera.pose()[:3, 3].float()
        if self._colours is None:
            self._colours, shown = torch.zeros(len(shape.corners), 3), torch.arange(len(shape.corners))
        else:
            shown = self._in_sight(origin)[(shape.corners // _VOXEL).unbind(-1)].nonzero()[:, 0]
        parts = shown.split(_BLOCK)
        for part, colours in zip(parts, map_pieces(lambda some: self._seen_colours(some, origin), parts), strict=True):
            self._colours[part] = colours
            yield
        texels = self._newest.clone()
        found = prefilter(self._colours, shape.neighbours, shown)
        texels[..., :3][shape.corners[shown].unbind(-1)] = colour_texels(found)
        self._newest = texels
        return shape.coloured(texels)

    @torch.inference_mode()
    def _seen_colours(self, part: Int[Tensor, "some"], origin: Float[Tensor, "3"]) -> Float[Tensor, "some 3"]:
        shape = self._shape
        points = _world(shape.field.extent, shape.field.cells, shape.box, shape.corners[part])
        towards = functional.normalize(points - origin, dim=-1).to(self._folded.device)
        features = shape.features.index_select(0, part.to(self._folded.device))
        return self._folded.colour(features, self._folded.direction_bias(towards)).cpu()

    def _in_sight(self, origin: Float[Tensor, "3"]) -> Bool[Tensor, "u v w"]:
        """Mark surface voxels with little optical depth between them and the camera."""
        size = 2 * self._extent * _VOXEL / self._shape.field.cells
        voxel = self._shown.nonzero()
        place = voxel + 0.5
        towards = origin - (place * size + torch.tensor(self._shape.box.first) * (size / _VOXEL) - self._extent)
        step = functional.normalize(towards, dim=-1) * size.max() / size
        around = functional.pad(self._shape.hidden, (1,) * 6)
        depth, last, strides = torch.zeros(len(place)), torch.tensor(around.shape) - 1, torch.tensor(around.stride())
        for index in range(_LOOK):
            at = (place + step * (_AHEAD + index) + 1).long().clamp_min(0).minimum(last)
            depth += around.view(-1)[(at * strides).sum(-1)]
        found = torch.zeros_like(self._shown)
        found[voxel.unbind(-1)] = depth < _BEHIND
        return found


def mixed(first: BakedField, second: BakedField, share: float) -> BakedField:
    """Mix two fields of the same grid; ``share`` is the second's weight, 0..1."""
    if share <= 0 or share >= 1:
        return first if share <= 0 else second
    weight = round(256 * share)
    texels = (first.texels.astype(np.uint16) * (256 - weight) + second.texels.astype(np.uint16) * weight + 128) >> 8
    distance = first.distance if first.distance is second.distance else np.minimum(first.distance, second.distance)
    return replace(first, texels=texels.astype(np.uint8), distance=distance)


def _world(
    extent: tuple[float, float, float], cells: int, box: Box, corners: Int[Tensor, "corners 3"]
) -> Float[Tensor, "corners 3"]:
    half = torch.tensor(extent)
    return (corners + torch.tensor(box.first)) * (2 * half / cells) - half


def _surface(density: Float[Tensor, "x y z"], thickness: Float[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """Mark corners that a camera may see: near occupied ones, and not deep inside along at least one axis."""
    deep = torch.full_like(thickness, torch.inf)
    for axis in range(3):
        through = thickness.cumsum(axis)
        before, after = through - thickness, through.select(axis, -1).unsqueeze(axis) - through
        deep = torch.minimum(deep, torch.minimum(before, after))
    near = functional.max_pool3d((density > _MIN_DENSITY)[None].float(), 3, 1, 1)[0] > 0
    return near & (deep < _BELOW)


def _filled_cells(density: Float[Tensor, "x y z"], cells: int, box: Box) -> Bool[Tensor, "cells cells cells"]:
    """Mark the scene's cells with a corner dense enough to draw."""
    side = cells // CELLS
    most = functional.max_pool3d(density[None], side + 1, side)[0]
    filled = torch.zeros((CELLS,) * 3, dtype=torch.bool)
    x, y, z = (slice(at // side, at // side + count) for at, count in zip(box.first, most.shape, strict=True))
    filled[x, y, z] = most > _MIN_DENSITY
    return filled


def _neighbours(seen: Bool[Tensor, "x y z"]) -> Int[Tensor, "seen 6"]:
    """Return :attr:`BakedShape.neighbours`."""
    own = torch.arange(int(seen.sum()), dtype=torch.int32)
    number = torch.full([side + 2 for side in seen.shape], -1, dtype=torch.int32)
    number[1:-1, 1:-1, 1:-1][seen] = own
    place = (number.flatten() >= 0).nonzero()[:, 0]
    found = []
    for stride in number.stride():
        pair = number.flatten()[place - stride], number.flatten()[place + stride]
        both = (pair[0] >= 0) & (pair[1] >= 0)
        found += [torch.where(both, one, own) for one in pair]
    return torch.stack(found, -1)


def prefilter(
    values: Float[Tensor, "seen channels"], neighbours: Int[Tensor, "seen 6"], which: Int[Tensor, "some"] | None = None
) -> Float[Tensor, "some channels"]:
    """Prefilter values at corners for unbiased linear interpolation: subtract a twelfth of the second differences.

    L. Condat, T. Blu and M. Unser, "Beyond interpolation: optimal reconstruction by quasi-interpolation", ICIP 2005.

    Args:
        neighbours: see :attr:`BakedShape.neighbours`.
        which: corners to return; None: all.
    """
    if which is not None:
        neighbours = neighbours[which]
    beside = functional.embedding_bag(neighbours, values, mode="sum")
    return 1.5 * (values if which is None else values[which]) - beside / 12
