"""Baking of an object into a 3D texture: density once, colours for several cameras around the object.

A texture holds the colours of one view, interpolated between the baked cameras (:meth:`BakedViews.seen_from`). Their
mean serves all views (:func:`bake`).

Density is prefiltered, since linear interpolation of exact values is biased where it curves: 2 to 6 dB
(:func:`prefilter`). Colours change within a cell of a crisp surface, which shows as rings like contour lines; so there
each corner has the colour of the surface next to it.
"""

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.detail.maps import detail_maps
from core.geometry.camera import Camera, Factors
from core.gl.baked_field import LOGITS, BakedField, cell_distances, colour_texels, logit_texels
from core.models.cells import corners_of, divide, unravelled
from core.models.density import density_to_logits
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS, Occupancy, shape_occupancy
from core.rendering.outline import outline
from core.runtime.caches import CACHE, Cached, CacheKind, byte_count
from core.runtime.pool import map_pieces

_DIVISIONS = (1, 2)  # texels along each edge of an occupied cell, from coarse to fine
_BLOCK = 4096  # corners that a thread evaluates at a time: the longest wait of a newer job
_AROUND = tuple(math.pi / 4 + side * math.pi / 2 for side in range(4))  # azimuths of cameras averaged for colours
_ELEVATION = math.radians(20)
_MIN_DENSITY = 0.1
"""per scene unit: a cell with less at all corners absorbs under 0.2 % of the light and counts as empty"""
_BELOW = 12.0  # optical depth along every axis beyond which no camera sees a point
_CRISP = 9.0  # logit slope per cell above which a corner moves to the surface; below it, colour varies with depth
_MOVES = 1.5, 0.5  # cells by which a corner moves at most in each Newton step towards the surface
MAX_TURN = math.radians(16)  # largest angle around the object from a camera to the nearest baked one
_REACH = 0.5  # rad, standard deviation of the kernel between cameras; 0.3 to 0.8 are as good


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
    solid = occupied.nonzero().cpu()
    low, high = (solid.amin(0), solid.amax(0) + 1) if len(solid) else (torch.zeros(3), torch.full((3,), CELLS))
    scale = cells // CELLS
    return Box(tuple((scale * low).int().tolist()), tuple((scale * high + 1).int().tolist()))


@dataclass(frozen=True, eq=False)
class BakedShape(Cached):
    """The baked values of an object that depend on neither texture nor camera."""

    field: BakedField  # without colours
    corners: Int[Tensor, "visible 3"]  # at the surface, so potentially visible; relative to the box's first corner
    points: Float[Tensor, "visible 3"]  # where colours are evaluated: the corner moved to the surface if that is near
    features: Float[Tensor, "visible width"]  # input of the colour (density), at the points

    def coloured(self, colours: Float[Tensor, "visible 3"]) -> BakedField:
        """Return the field with these colours."""
        texels = torch.from_numpy(self.field.texels).clone()
        texels[..., :3][self.corners.unbind(-1)] = colour_texels(colours)
        return replace(self.field, texels=texels.numpy())


def _bake_shape(
    model: Model, folded: FoldedField, occupancy: Occupancy, cells: int
) -> Generator[None, None, BakedShape]:
    """Evaluate densities in the occupied cells and features at the surface; yields after every few thousand corners."""
    box = box_of(occupancy.cells, cells)
    config = model.field.config
    cell = 2 * max(model.extent) / cells
    density = yield from _bake_density(model, folded, occupancy, cells, box)
    visible = _surface(density, density * cell)
    logits = density_to_logits(density, config)
    corners = visible.nonzero()
    slope = torch.stack(torch.gradient(logits.clamp(*LOGITS)), -1)[visible] * (cells / (2 * torch.tensor(model.extent)))
    starts = _world(model.extent, cells, box, corners), logits[visible], slope
    pieces = zip(*(values.split(_BLOCK) for values in starts), strict=True)
    surface = list[tuple[Float[Tensor, "points 3"], Float[Tensor, "points width"]]]()
    for moved in map_pieces(lambda piece: _onto_surface(folded, cell, *piece), pieces):
        surface.append(moved)
        yield
    logits[visible] = prefilter(logits[visible][:, None], _neighbours(visible))[:, 0]
    texels = torch.zeros(*box.sides, 4, dtype=torch.uint8)
    texels[..., 3] = logit_texels(logits)
    distance = cell_distances(_filled_cells(density, cells, box))
    field = BakedField(
        texels.numpy(), distance, model.extent, config, model.pixel_offset, cells, box.first, shadow=occupancy.shadow
    )
    points, features = (torch.cat(blocks) for blocks in zip(*surface, strict=True))
    return BakedShape(field, corners, points, features)


def _bake_density(
    model: Model, folded: FoldedField, occupancy: Occupancy, cells: int, box: Box
) -> Generator[None, None, Float[Tensor, "x y z"]]:
    """Evaluate densities at the corners of occupied cells, block by block; 0 at other corners of the box."""
    occupied = corners_of(divide(occupancy.cells, cells // CELLS)).flatten().nonzero()[:, 0].cpu()
    blocks = (unravelled(occupied, cells + 1) - torch.tensor(box.first)).split(_BLOCK)

    @torch.inference_mode()
    def evaluate(corners: Int[Tensor, "corners 3"]) -> Float[Tensor, "corners"]:
        return folded.density(_world(model.extent, cells, box, corners).to(folded.device))[0].cpu()

    density = torch.zeros(box.sides)
    for block, values in zip(blocks, map_pieces(evaluate, blocks), strict=True):
        density[block.unbind(-1)] = values
        yield
    return density


@dataclass(frozen=True, eq=False)
class BakedViews:
    """An object's baked shape, with the colours of its corners for several cameras."""

    shape: BakedShape
    cameras: tuple[Camera, ...]  # of the object's own space (:meth:`core.models.model.Instance.local_camera`)
    colours: Float[Tensor, "cameras visible 3"]
    proportions: Factors | None  # as those of fields

    def mean(self) -> BakedField:
        """Return the field with mean colours over the cameras, for all views."""
        return self.shape.coloured(self.colours.mean(0)).stretched(self.proportions)

    def seen_from(self, camera: Camera) -> BakedField:
        """Return the field with colours for a camera, which may lie between the baked ones."""
        weights = self._weights(camera.stretched(self.proportions))
        return self.shape.coloured(torch.einsum("c,cnk->nk", weights, self.colours)).stretched(self.proportions)

    def _weights(self, camera: Camera) -> Float[Tensor, "cameras"]:
        """Interpolate between the cameras by a Gaussian process over directions; the weights' sum is 1."""
        baked = torch.stack([_direction(camera) for camera in self.cameras])
        variance = _kernel(baked, baked) + 1e-4 * torch.eye(len(baked))
        weights = torch.linalg.solve(variance, _kernel(baked, _direction(camera)[None]))[:, 0]
        return (weights / weights.sum()).float()


def bake_views(instance: Instance, cameras: Sequence[Camera], cells: int) -> Generator[None, None, BakedViews]:
    """Bake an object's shape and its colours for :func:`spread` cameras; yields after every few thousand corners.

    The shape is cached while memory is free, so that another texture bakes colours only.

    Args:
        cells: of the grid, along each axis of the scene's box; a multiple of :data:`~core.rendering.occupancy.CELLS`.
    """
    with torch.inference_mode():
        folded = FoldedField.of(instance)
        occupancy = shape_occupancy(instance)
    key = instance.model, instance.codes.shape_key, outline(instance), cells
    shape: BakedShape | None = CACHE.get(CacheKind.VIEW, key)
    if shape is None:
        shape = yield from _bake_shape(instance.model, folded, occupancy, cells)
        size = byte_count(shape)
        if size <= CACHE.limit - CACHE.used:
            CACHE.put(CacheKind.VIEW, key, shape, size)
    cameras = spread([instance.local_camera(camera) for camera in cameras])
    colours = list[Float[Tensor, "cameras block 3"]]()
    evaluate = partial(_colours, folded, shape, cameras)
    for block in map_pieces(evaluate, torch.arange(len(shape.corners)).split(_BLOCK)):
        colours.append(block)
        yield
    return BakedViews(shape, tuple(cameras), torch.cat(colours, 1), instance.codes.proportions)


@torch.inference_mode()
def _colours(
    folded: FoldedField, shape: BakedShape, cameras: Sequence[Camera], block: Int[Tensor, "block"]
) -> Float[Tensor, "cameras block 3"]:
    """Return the colours that each camera sees at the corners with these indices."""
    features = shape.features.index_select(0, block.to(folded.device))
    colours = list[Float[Tensor, "block 3"]]()
    for camera in cameras:
        direction = functional.normalize(shape.points[block] - camera.pose()[:3, 3].float(), dim=-1)
        colours.append(folded.colour(features, folded.direction_bias(direction.to(folded.device))).cpu())
    return torch.stack(colours)


def bake(instance: Instance) -> Iterator[BakedField | None]:
    """Bake an object with its photo detail and mean colours over four cameras: 64 cells per axis, then 128.

    Yields None many times between. The texels of an object and of its stretched forms are the same.
    """
    maps = yield from detail_maps(instance)
    cameras = [instance.model.camera(azimuth, _ELEVATION) for azimuth in _AROUND]
    for divisions in _DIVISIONS:
        views = yield from bake_views(instance.unstretched, cameras, CELLS * divisions)
        yield replace(views.mean(), detail=maps).stretched(instance.codes.proportions)


def _world(
    extent: tuple[float, float, float], cells: int, box: Box, corners: Int[Tensor, "corners 3"]
) -> Float[Tensor, "corners 3"]:
    half = torch.tensor(extent)
    return (corners + torch.tensor(box.first)) * (2 * half / cells) - half


@torch.inference_mode()
def _onto_surface(
    folded: FoldedField,
    cell: float,
    points: Float[Tensor, "points 3"],
    logits: Float[Tensor, "points"],
    slope: Float[Tensor, "points 3"],
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points width"]]:
    """Move points to the surface by Newton steps, and return them with their features.

    The surface is where a cell has optical depth 1. Points move only if it is near, and less if it is soft.

    Args:
        cell: its length, scene units.
        slope: gradient of the logits, per scene unit.
    """
    level = density_to_logits(torch.tensor(1 / cell), folded.field.config)
    crisp = (slope.norm(dim=-1, keepdim=True) * cell / _CRISP).square().clamp_max(1)
    for limit in _MOVES:
        step = slope * ((level - logits) / slope.square().sum(-1).clamp_min(1e-6))[:, None]
        points = points + crisp * step / (step.norm(dim=-1, keepdim=True) / (limit * cell)).clamp_min(1)
        density, features = folded.density(points.to(folded.device))
        logits = density_to_logits(density.cpu(), folded.field.config)
    return points, features


def _surface(density: Float[Tensor, "x y z"], thickness: Float[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """Mark corners that a camera may see: near occupied ones, and not deep inside along at least one axis."""
    deep = torch.full_like(thickness, torch.inf)
    for axis in range(3):
        through = thickness.cumsum(axis)
        depth_before = through - thickness
        behind = through.select(axis, -1).unsqueeze(axis) - through
        deep = torch.minimum(deep, torch.minimum(depth_before, behind))
    near = functional.max_pool3d((density > _MIN_DENSITY)[None].float(), 3, 1, 1)[0] > 0
    return near & (deep < _BELOW)


def _filled_cells(density: Float[Tensor, "x y z"], cells: int, box: Box) -> Bool[Tensor, "cells cells cells"]:
    """Mark the scene's cells with a corner dense enough to draw."""
    side = cells // CELLS
    top = functional.max_pool3d(density[None], side + 1, side)[0]
    filled = torch.zeros((CELLS,) * 3, dtype=torch.bool)
    x, y, z = (slice(start // side, start // side + count) for start, count in zip(box.first, top.shape, strict=True))
    filled[x, y, z] = top > _MIN_DENSITY
    return filled


def _neighbours(visible: Bool[Tensor, "x y z"]) -> Int[Tensor, "visible 6"]:
    """Return the two neighbours along each axis; the corner itself if one of the two is not at the surface."""
    numbers = torch.arange(int(visible.sum()), dtype=torch.int32)
    number = torch.full([side + 2 for side in visible.shape], -1, dtype=torch.int32)
    number[1:-1, 1:-1, 1:-1][visible] = numbers
    cell = (number.flatten() >= 0).nonzero()[:, 0]
    neighbours = []
    for stride in number.stride():
        pair = number.flatten()[cell - stride], number.flatten()[cell + stride]
        both = (pair[0] >= 0) & (pair[1] >= 0)
        neighbours += [torch.where(both, neighbour, numbers) for neighbour in pair]
    return torch.stack(neighbours, -1)


def prefilter(
    values: Float[Tensor, "visible channels"], neighbours: Int[Tensor, "visible 6"]
) -> Float[Tensor, "visible channels"]:
    """Prefilter values at corners for unbiased linear interpolation: subtract a twelfth of the second differences.

    L. Condat, T. Blu and M. Unser, "Beyond interpolation: optimal reconstruction by quasi-interpolation", ICIP 2005.
    """
    return 1.5 * values - functional.embedding_bag(neighbours, values, mode="sum") / 12


def spread(cameras: Sequence[Camera]) -> list[Camera]:
    """Choose the last camera, then the farthest from those chosen until each has one within :data:`MAX_TURN`."""
    directions = torch.stack([_direction(camera) for camera in cameras])
    selected = [len(cameras) - 1]
    while True:
        distance = torch.cdist(directions, directions[selected]).amin(1)
        farthest = int(distance.argmax())
        if distance[farthest] <= MAX_TURN:
            return [cameras[index] for index in selected]
        selected.append(farthest)


def _direction(camera: Camera) -> Float[Tensor, "3"]:
    """Return the unit vector from the origin to a camera."""
    return functional.normalize(camera.pose()[:3, 3].double(), dim=0)


def _kernel(first: Float[Tensor, "n 3"], second: Float[Tensor, "m 3"]) -> Float[Tensor, "n m"]:
    return (torch.cdist(first, second).square() / (-2 * _REACH**2)).exp()
