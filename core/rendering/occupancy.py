"""Occupancy grid: which cells of the scene's box can hold a part of the object.

Densities are evaluated at the corners of the cells and a cell counts as occupied where one of its eight corners is, so
that a part as thick as a cell is never lost. The first layer's activations there depend on no code and are kept per
model: a new shape costs a few small layers. Where no training object of the model has anything, every second corner is
evaluated at first, and the others only if there is something after all.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera, project
from core.geometry.rays import Rays
from core.models.cells import contains, corner_points, corners_of, divide, max_of_corners, with_neighbours
from core.models.model import Model
from core.models.occupied_cells import CELLS as STORED_CELLS
from core.rendering.folded_field import FoldedField
from core.rendering.ground_shadow import cast_shadow
from core.runtime.layers import pad_rows

CELLS = 64  # Cells along each axis of the box.
_MIN_OPACITY = 0.001  # A corner whose cell would take less of the light than this is empty.
_SOLID = 0.7  # A corner whose cell has at least this optical depth, half of the light, is inside the object.
_FINE_TOLERANCE = 0.002  # Share of a ray's light that may be neglected with _FINE_SAMPLES intervals.
_FINE_SAMPLES = 192
_MAX_TOLERANCE = 0.03  # share of the light, with few intervals
_COARSE_FACTOR = 2  # Cells along each axis that make a coarse cell, for the outline.
_BLOCK = 16384


class Tolerances(NamedTuple):
    """Limits below which parts of a ray are neglected: early ray termination and intervals too faint to colour."""

    termination: float  # optical depth: intervals behind more than this are not evaluated
    min_weight: float  # share of the object's light in a ray: intervals that give less are not coloured


def tolerances(samples: int) -> Tolerances:
    """The tolerances for so many intervals, growing as the error of their sum does: with the square of their length."""
    tolerance = min(_MAX_TOLERANCE, _FINE_TOLERANCE * (_FINE_SAMPLES / samples) ** 2)
    return Tolerances(termination=-math.log(tolerance), min_weight=tolerance / 3)


class OccupiedIntervals(NamedTuple):
    """Intervals of rays that can hold something, ray by ray, from near to far."""

    ray: Int[Tensor, "crossed"]
    interval: Int[Tensor, "crossed"]
    occluded: Bool[Tensor, "crossed"]
    """Even the thinnest corners of the cells in front take all the light that counts, so it probably lies behind."""


class Occupancy:
    """The occupied cells of one shape.

    Args:
        previous: the occupancy of a similar shape. Corners are evaluated around it, and elsewhere only every second
            one, or every fourth where no training object has anything: a few times faster, and enough while a shape
            changes. Something thin far from it is missed.
    """

    def __init__(self, model: Model, folded: FoldedField, previous: "Occupancy | None" = None) -> None:
        self.extent, self.complete = model.extent_tensor, previous is None
        self.cell = 2 * self.extent / CELLS
        known = _corners(model, folded.dtype)
        limit = _MIN_OPACITY / float(self.cell.amin())
        with torch.inference_mode():
            if previous:
                rows = (previous._around() | known.sparse).index_select(0, known.corner).nonzero()[:, 0]
                corners = _densities_around(folded, known, rows)
            else:
                corners = _complete_densities(folded, known, limit)
        self.cells: Bool[Tensor, "cells cells cells"] = max_of_corners(corners) > limit
        solid = (corners > _SOLID / float(self.cell.amin())).cpu()
        self.shadow = None if model.white_from_network else cast_shadow(solid, model.extent)
        """of the shape on the ground below it; None of nothing, and of a network that paints the background"""
        self._flat = self.cells.flatten()
        self._min_density = -max_of_corners(-corners).flatten().bfloat16()  # 0.4 % off at most: below tolerances
        self._coarse = functional.max_pool3d(self.cells[None].float(), _COARSE_FACTOR)[0] > 0
        self._centres = (self._coarse.nonzero() + 0.5) * self.cell * _COARSE_FACTOR - self.extent

    @property
    def size(self) -> int:
        """bytes"""
        return sum(part.nbytes for part in vars(self).values() if isinstance(part, Tensor))

    def _around(self) -> Bool[Tensor, "all"]:
        """Which corners are those of the occupied cells and of all that touch them."""
        return corners_of(with_neighbours(self.cells)).flatten()

    def contains(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether each point of the box lies in an occupied cell."""
        return contains(self.cells[None], points.reshape(1, -1, 3), self.extent).reshape(points.shape[:-1])

    def intersect(self, rays: Rays, step: float, termination: float) -> OccupiedIntervals:
        """Which intervals of each ray, ``step`` long and counted from ``near``, can hold any of the object: those whose
        middle lies in an occupied cell. ``termination`` is :attr:`Tolerances.termination`.
        """
        cell, inside = self._cells_along(rays, step)
        occupied = (self._flat.index_select(0, cell) & inside).nonzero()[:, 0]
        ray = occupied // (len(cell) // len(rays.near))
        interval = occupied - ray * (len(cell) // len(rays.near))
        least = self._min_density.index_select(0, cell.index_select(0, occupied)).float() * step
        counts = torch.bincount(ray)
        occluded = _cumulative_per_ray(least, counts.cumsum(0) - counts, ray) - least > termination
        return OccupiedIntervals(ray, interval, occluded)

    def _cells_along(self, rays: Rays, step: float) -> tuple[Int[Tensor, "all"], Bool[Tensor, "all"]]:
        """The cell in which the middle of each interval lies, ray by ray, and whether the ray reaches it."""
        length = (rays.far - rays.near) / step
        along = torch.arange(max(1, math.ceil(float(length.amax()))), device=length.device) + 0.5
        step_cells = rays.directions * step / self.cell
        first = (rays.origins + rays.directions * rays.near[:, None] + self.extent) / self.cell
        # Whole numbers, which floats hold exactly: fewer passes over memory than with integers.
        x, y, z = (
            torch.addcmul(first.T[..., None], step_cells.T[..., None], along).clamp_(0, CELLS - 1).floor_().unbind()
        )
        cell = torch.add(z, torch.add(y, x, alpha=CELLS), alpha=CELLS)
        return cell.int().flatten(), (along < length[:, None]).flatten()

    def depth_range(
        self, camera: Camera, pixel_offset: float = 0.0
    ) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
        """Nearest and farthest distance from the camera of the occupied cells behind every pixel; near > far: none.

        Coarse cells are splatted (:func:`splat`): at most a cell too much. ``pixel_offset`` as in
        :func:`core.geometry.rays.camera_rays`.
        """
        local = camera.to_camera_axes(self._centres)
        points = project(local, camera.focal, (camera.width, camera.height)) + pixel_offset
        reach = float((self.cell * _COARSE_FACTOR).norm()) / 2
        tiles = splat(local, points, reach, camera.focal, (camera.width, camera.height))
        rows, columns = (
            ((torch.arange(pixels, device=local.device) + 0.5) * (count / pixels)).long()
            for pixels, count in zip((camera.height, camera.width), tiles[0].shape, strict=True)
        )
        near, far = (tile.index_select(0, rows).index_select(1, columns) for tile in tiles)
        return near, far


def splat(
    local: Float[Tensor, "cells 3"], points: Float[Tensor, "cells 2"], reach: float, focal: float, size: tuple[int, int]
) -> tuple[Float[Tensor, "rows columns"], Float[Tensor, "rows columns"]]:
    """Nearest and farthest distance from the camera of what is behind each tile of an image; near > far: nothing.

    A tile is at least as large as half a cell looks, and each cell covers the 3x3 tiles around its centre: never too
    little.

    Args:
        local: centres of cells in camera axes.
        points: where they are in the image, px.
        reach: scene units, half of a cell's diagonal.
        size: px, width and height of the image.
    """
    depth, before = local.norm(dim=-1), -local[:, 2]
    closest = float((before.amin() if len(before) else torch.tensor(1.0)).clamp_min(1e-3))
    side = max(1.0, reach * focal / closest)
    columns, rows = (max(1, -int(-pixels // side)) for pixels in size)
    # A margin of one all round holds the centres of cells that reach in from outside; one more, all others.
    x = (points[:, 0] * (columns / size[0])).floor().long() + 1
    y = (points[:, 1] * (rows / size[1])).floor().long() + 1
    on = (before > 1e-3) & (x >= 0) & (x < columns + 2) & (y >= 0) & (y < rows + 2)
    count = (rows + 2) * (columns + 2)
    at = torch.where(on, y * (columns + 2) + x, count)
    reached = torch.full((2, count + 1), -torch.inf, device=local.device)
    reached[0].scatter_reduce_(0, at, reach - depth, "amax")
    reached[1].scatter_reduce_(0, at, reach + depth, "amax")
    tiles = reached[:, :-1].unflatten(1, (rows + 2, columns + 2))
    tiles = torch.maximum(torch.maximum(tiles[:, :-2], tiles[:, 1:-1]), tiles[:, 2:])
    tiles = torch.maximum(torch.maximum(tiles[..., :-2], tiles[..., 1:-1]), tiles[..., 2:])
    return -tiles[0], tiles[1]


def _cumulative_per_ray(
    values: Float[Tensor, "crossed"], first: Int[Tensor, "rays"], ray: Int[Tensor, "crossed"]
) -> Float[Tensor, "crossed"]:
    """Sums along each ray up to and with every interval; intervals lie ray by ray, each from its ``first`` one."""
    whole = values.cumsum(0, dtype=torch.double)
    before = functional.pad(whole, (1, 0)).index_select(0, first)
    return (whole - before.index_select(0, ray)).float()


class _Corners(NamedTuple):
    """The corners of the grid of a model, those first that are always evaluated."""

    corner: Int[Tensor, "all"]  # which of the grid, row by row
    activations: Float[Tensor, "all width"]  # of the first layer, in this order
    likely: int  # how many are in the cells that training objects occupy
    always: int  # how many are evaluated of every shape: those, and every second one elsewhere
    sparse: Bool[Tensor, "all"]
    """in the order of the grid: those evaluated of a shape that changes, wherever it was before"""


def _complete_densities(folded: FoldedField, known: _Corners, limit: float) -> Float[Tensor, "corners corners corners"]:
    """Densities at all corners, 0 where training objects have nothing and this shape has not either."""
    found = torch.zeros(len(known.corner), device=known.corner.device)

    def evaluate(rows: slice) -> Float[Tensor, "rows"]:
        parts = known.activations[rows].split(_BLOCK)
        return torch.cat([folded.unbounded_density(part)[0] for part in parts])

    densities = evaluate(slice(0, known.always))
    found[known.corner[: known.always]] = densities
    if bool((densities[known.likely :] > limit).any()):
        found[known.corner[known.always :]] = evaluate(slice(known.always, None))
    return found.reshape(CELLS + 1, CELLS + 1, CELLS + 1)


def _densities_around(
    folded: FoldedField, known: _Corners, rows: Int[Tensor, "some"]
) -> Float[Tensor, "corners corners corners"]:
    """Densities at some corners, numbered as in ``known.corner``; 0 at the others."""
    found = torch.zeros(len(known.corner), device=rows.device)
    for part in rows.split(_BLOCK):
        activations = known.activations.index_select(0, pad_rows(part))
        found[known.corner[part]] = folded.unbounded_density(activations)[0][: len(part)]
    return found.reshape(CELLS + 1, CELLS + 1, CELLS + 1)


@lru_cache(maxsize=1)  # 53 MB, and a fraction of a second
def _corners(model: Model, dtype: torch.dtype) -> _Corners:
    """The corners of the grid, with their first-layer activations."""
    likely = _likely_corners(model)
    second, fourth = torch.zeros_like(likely), torch.zeros_like(likely)
    second[::2, ::2, ::2] = fourth[::4, ::4, ::4] = True
    turn = torch.where(likely, 0, torch.where(second, 1, 2)).flatten()
    corner = turn.argsort(stable=True)
    points = corner_points(model.extent_tensor, CELLS)[corner]
    folded = FoldedField(model, model.codes.mean)
    assert folded.dtype == dtype
    with torch.inference_mode():
        activations = torch.cat([folded.first_layer(part) for part in points.split(_BLOCK)])
    sparse = torch.where(likely, second, fourth).flatten()
    return _Corners(corner, activations, int((turn == 0).sum()), int((turn < 2).sum()), sparse)


def _likely_corners(model: Model) -> Bool[Tensor, "corners corners corners"]:
    """The corners of the cells that training objects occupy, all where the model's file does not tell these cells."""
    if model.stored_cells is None:
        return torch.ones((CELLS + 1,) * 3, dtype=torch.bool, device=model.device)
    return corners_of(divide(model.stored_cells.to(model.device), CELLS // STORED_CELLS))
