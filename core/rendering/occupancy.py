"""Occupancy grid: the cells of the scene's box that may contain part of the object.

Densities are evaluated at corners, and a cell is occupied if one of its eight corners is: no part as thick as a cell is
missed. First-layer activations at the corners depend on no code and are cached per model, so a new shape costs only a
few small layers. Outside the cells of training objects, every second corner is evaluated first, and the others only if
one of these is occupied.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.edits.edit import Edit
from core.geometry.camera import Camera
from core.geometry.rays import Rays
from core.models.cells import contains, corner_points, corners_of, divide, max_of_corners, with_neighbours
from core.models.latents import Latents
from core.models.model import Instance, Model
from core.models.network import has_network
from core.models.occupied_cells import CELLS as STORED_CELLS
from core.rendering.folded_field import FoldedField
from core.rendering.ground_shadow import cast_shadow
from core.rendering.splatting import splat
from core.runtime.caches import CACHE, Cached, CacheKind, byte_count
from core.runtime.layers import pad_rows
from core.runtime.pool import map_pieces

CELLS = 64  # along each axis of the box
_MIN_OPACITY = 0.001  # a corner is empty if a cell of its density absorbs a smaller fraction of the light
_SOLID = 0.7  # optical depth of one cell, ln 2: a denser corner is inside the object
_FINE_TOLERANCE = 0.002  # fraction of a ray's light that may be neglected with _FINE_SAMPLES intervals
_FINE_SAMPLES = 192
_MAX_TOLERANCE = 0.03  # fraction of the light, with few intervals
_COARSE_FACTOR = 2  # cells along each axis of a coarse cell, the unit of depth ranges
_SIMILAR_DISTANCE = 0.25
"""Standard deviations of the trained shapes: a shape this close to the last one reuses its occupied cells."""
_BLOCK = 4096  # corners that a thread evaluates at a time
_JOINED = 0.05  # optical depth of a cell, from which it joins its neighbours to a piece
_PIECE = 0.01  # share of the object's cells, below which a piece that lies apart is not drawn
_SAME_LAYER = 1e-3  # cells: rounding of an edit, by which a layer of cells touches another one


def _limit(model: Model) -> float:
    """Return the density per scene unit from which a corner is occupied."""
    return _MIN_OPACITY / float((2 * model.extent_tensor / CELLS).amin())


class Tolerances(NamedTuple):
    """Limits for skipping parts of a ray: early termination, and intervals too faint to colour."""

    termination: float  # optical depth beyond which intervals are not evaluated
    min_weight: float  # fraction of the object's light in a ray below which intervals are not coloured


def tolerances(samples: int) -> Tolerances:
    """Return tolerances for ``samples`` intervals along the longest side of the scene's box.

    They grow with the square of the interval's length, as does the error of Eq. 3's sum.
    """
    tolerance = min(_MAX_TOLERANCE, _FINE_TOLERANCE * (_FINE_SAMPLES / samples) ** 2)
    return Tolerances(termination=-math.log(tolerance), min_weight=tolerance / 3)


class OccupiedIntervals(NamedTuple):
    """Intervals of rays in occupied cells, ray by ray, from near to far."""

    ray: Int[Tensor, "crossed"]  # index of the ray
    interval: Int[Tensor, "crossed"]  # number of the interval along the ray, 0 at `near`
    occluded: Bool[Tensor, "crossed"]  # the minimum densities of the cells in front already absorb all relevant light


class Occupancy(Cached):
    """The occupied cells of one shape (``cells``, 64 along each axis), and its shadow on the ground (``shadow``).

    Args:
        densities: at the corners.
        complete: False: thin parts that lie apart may be missing.
        cells, min_density: occupied cells, and the least density in each; None: as the corners tell.
    """

    def __init__(
        self,
        model: Model,
        densities: Float[Tensor, "corners corners corners"],
        complete: bool = True,
        cells: Bool[Tensor, "cells cells cells"] | None = None,
        min_density: Float[Tensor, "cells cells cells"] | None = None,
    ) -> None:
        self.extent = model.extent_tensor
        self.complete = complete
        self.cell = 2 * self.extent / CELLS
        self.cells = max_of_corners(densities) > _limit(model) if cells is None else cells
        relative = (densities * (float(self.cell.amin()) / _SOLID)).cpu()
        self.shadow = None if model.white_from_network else cast_shadow(relative, model.extent)
        """The shape's shadow on the ground; None if it is empty or the network paints the background."""
        self._model = model
        self._densities = densities
        self._flat = self.cells.flatten()
        min_density = -max_of_corners(-densities) if min_density is None else min_density
        self._min_density = min_density.flatten().bfloat16()  # rounds by 0.4 %, below tolerances
        self._coarse = functional.max_pool3d(self.cells[None].float(), _COARSE_FACTOR)[0] > 0
        self._centres = (self._coarse.nonzero() + 0.5) * self.cell * _COARSE_FACTOR - self.extent

    @classmethod
    @torch.inference_mode()
    def of(cls, model: Model, folded: FoldedField, previous: "Occupancy | None" = None) -> "Occupancy":
        """Find the occupied cells of a shape without edits of its space.

        Args:
            previous: the occupancy of a similar shape, to find that of a changing shape a few times faster. Corners
                around its cells are evaluated; elsewhere every second one, or every fourth outside the cells of
                training objects. This misses thin parts that lie apart, so the result is not ``complete``.
        """
        grid = _corners(model, folded.dtype)
        if previous is None:
            return cls(model, without_pieces(_complete_densities(folded, grid, _limit(model)), model))
        # Corners of the cells of the similar shape and of all cells that touch them, and a few of all others.
        nearby = corners_of(with_neighbours(previous.cells)).flatten() | grid.sparse
        rows = nearby.index_select(0, grid.corner).nonzero()[:, 0]
        densities = _densities_at(folded, rows, grid.corner[rows], partial(grid.activations.index_select, 0))
        return cls(model, without_pieces(densities, model), complete=False)

    @torch.inference_mode()
    def moved(self, edit: Edit, folded: FoldedField) -> "Occupancy":
        """Return the occupied cells of the shape after one more edit of its space.

        An edit that moves whole layers of cells needs no evaluation of the field: a cell is occupied if any that its
        place came from is, and densities at corners, which cast the shadow, are interpolated.

        Args:
            folded: the edited field.
        """
        if not edit.is_separable:
            return Occupancy(self._model, _moved_densities(folded, self, edit), self.complete)
        densities = self._densities
        cells = self.cells
        min_density = self._min_density.view(cells.shape)
        corners = torch.arange(CELLS + 1, device=self.cell.device)[:, None] * self.cell - self.extent
        layers = ((edit.origins(corners) + self.extent) / self.cell).clamp(0, CELLS)
        for axis, layer in enumerate(layers.unbind(-1)):
            if bool(((layer - torch.arange(CELLS + 1, device=layer.device)).abs() < _SAME_LAYER).all()):
                continue
            first = (layer[:-1] + _SAME_LAYER).long().clamp(max=CELLS - 1)
            last = torch.maximum((layer[1:] - _SAME_LAYER).long(), first)
            lower = layer.long().clamp(max=CELLS - 1)
            start, end = (densities.index_select(axis, lower + side) for side in (0, 1))
            fractions = (layer - lower).float()[(..., *[None] * (2 - axis))]
            densities = torch.lerp(start, end, fractions)
            steps = [torch.minimum(first + step, last) for step in range(int((last - first).amax()) + 1)]
            cells = torch.stack([cells.index_select(axis, step) for step in steps]).any(0)
            min_density = torch.stack([min_density.index_select(axis, step) for step in steps]).amin(0)
        return Occupancy(self._model, densities, self.complete, cells, min_density)

    def points_in(self, cells: Int[Tensor, "cells 3"], per_side: int) -> Float[Tensor, "points 3"]:
        """Return evenly spaced points in cells (scene units), ``per_side`` along each side of a cell."""
        steps = (torch.arange(per_side, device=cells.device) + 0.5) / per_side
        within = torch.cartesian_prod(steps, steps, steps)
        return ((cells[:, None] + within) * self.cell - self.extent).flatten(0, 1)

    def contains(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Mark the points of the box that lie in an occupied cell."""
        return contains(self.cells[None], points.reshape(1, -1, 3), self.extent).reshape(points.shape[:-1])

    def intersect(self, rays: Rays, step: float, termination: float) -> OccupiedIntervals:
        """Find the intervals of rays whose middle lies in an occupied cell.

        Args:
            step: length of the intervals, the first of which begins at ``rays.near``; scene units.
            termination: see :class:`Tolerances`.
        """
        cell, inside = self._cells_along(rays, step)
        occupied = (self._flat.index_select(0, cell) & inside).nonzero()[:, 0]
        ray = occupied // (len(cell) // len(rays.near))
        interval = occupied - ray * (len(cell) // len(rays.near))
        thickness = self._min_density.index_select(0, cell.index_select(0, occupied)).float() * step
        counts = torch.bincount(ray)
        total = thickness.cumsum(0, dtype=torch.double)
        before_rays = functional.pad(total, (1, 0)).index_select(0, counts.cumsum(0) - counts)
        depth = (total - before_rays.index_select(0, ray)).float() - thickness  # optical depth of the cells in front
        return OccupiedIntervals(ray, interval, depth > termination)

    def _cells_along(self, rays: Rays, step: float) -> tuple[Int[Tensor, "all"], Bool[Tensor, "all"]]:
        """Return the cell at the middle of each interval, ray by ray, and True if that lies before ``rays.far``."""
        length = (rays.far - rays.near) / step
        middles = torch.arange(max(1, math.ceil(float(length.amax()))), device=length.device) + 0.5
        step_cells = rays.directions * step / self.cell
        first = (rays.origins + rays.directions * rays.near[:, None] + self.extent) / self.cell
        # Whole numbers, which floats hold exactly: fewer passes over memory than with integers.
        x, y, z = (
            torch.addcmul(first.T[..., None], step_cells.T[..., None], middles).clamp_(0, CELLS - 1).floor_().unbind()
        )
        cell = torch.add(z, torch.add(y, x, alpha=CELLS), alpha=CELLS)
        return cell.int().flatten(), (middles < length[:, None]).flatten()

    def depth_range(
        self, camera: Camera, pixel_offset: float = 0.0
    ) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
        """Return the nearest and the farthest distance of occupied cells behind every pixel; near > far: none.

        Coarse cells are splatted (:func:`splat`), so a range may be too long, never too short. The offset is that of
        :func:`core.geometry.rays.camera_rays`.
        """
        radius = float((self.cell * _COARSE_FACTOR).norm()) / 2
        tiles = splat(camera, self._centres, radius, (camera.width, camera.height), (pixel_offset, pixel_offset))
        rows, columns = (
            ((torch.arange(pixels, device=self.cell.device) + 0.5) * (count / pixels)).long()
            for pixels, count in zip((camera.height, camera.width), tiles[0].shape, strict=True)
        )
        near, far = (tile.index_select(0, rows).index_select(1, columns) for tile in tiles)
        return near, far


def shape_occupancy(instance: Instance, complete: bool = True, edits: tuple[Edit, ...] | None = None) -> Occupancy:
    """Return a shape's occupied cells, cached because they depend on neither view nor texture.

    Args:
        complete: False: if the shape is similar to the last one, evaluate mainly the corners around that; for
            continuously changing shapes.
        edits: the first of the shape's edits of space, without the others; None: all.
    """
    edits = instance.codes.space_edits if edits is None else edits
    unmoved = instance.unmoved
    key = instance.model, unmoved.codes.untextured, edits
    occupancy: Occupancy | None = CACHE.get(CacheKind.SHAPE, key)
    if occupancy is None or (complete and not occupancy.complete):
        if edits:
            folded = FoldedField.of(unmoved.changed(edits=(*unmoved.codes.edits, *edits)))
            occupancy = shape_occupancy(instance, complete, edits[:-1]).moved(edits[-1], folded)
        else:
            previous = None if complete else _similar_occupancy(instance)
            occupancy = Occupancy.of(instance.model, FoldedField.of(unmoved), previous)
        CACHE.put(CacheKind.SHAPE, key, occupancy, byte_count(occupancy))
    return occupancy


def _similar_occupancy(instance: Instance) -> Occupancy | None:
    """Return the occupied cells of the model's last shape, without edits, if this one is similar to it."""
    codes = instance.codes
    space = instance.model.codes.shape_space
    for (model, last, edits), occupancy in CACHE.newest(CacheKind.SHAPE):
        if model is instance.model and not edits:
            if has_network(model, codes.untextured) != has_network(model, last):
                return None
            away = float(space.distance(codes.shape, last.shape))
            offset_away = float((_bias_offsets(model, codes) - _bias_offsets(model, last)).square().mean().sqrt())
            return occupancy if max(away, offset_away) < _SIMILAR_DISTANCE else None
    return None


def _bias_offsets(model: Model, latents: Latents) -> Float[Tensor, "*blocks_width"]:
    """Return the offsets of the shape blocks' biases, standard deviations; along with these, a network changes."""
    offsets = latents.shape_offsets
    return torch.zeros(()) if offsets is None else offsets[: model.field.config.shape_blocks].float()


class _Corners(NamedTuple):
    """The corners of a model's grid in the order of evaluation: likely ones, every second one elsewhere, the rest."""

    corner: Int[Tensor, "all"]  # index in the grid, row by row
    activations: Float[Tensor, "all width"]  # outputs of the first layer, in the order of evaluation
    likely: int  # number of corners in the cells of training objects
    always: int  # number of corners evaluated for every shape: likely ones, and every second one elsewhere
    sparse: Bool[Tensor, "all"]  # row by row: corners evaluated for every preview of a changing shape


def _complete_densities(folded: FoldedField, grid: _Corners, limit: float) -> Float[Tensor, "corners corners corners"]:
    """Return densities at all corners.

    0 where not evaluated: beyond ``grid.always`` unless a corner outside the likely cells is occupied.
    """
    densities = torch.zeros(len(grid.corner), device=grid.corner.device)

    def evaluate(rows: slice) -> Float[Tensor, "rows"]:
        blocks = grid.activations[rows].split(_BLOCK)
        return torch.cat(list(map_pieces(lambda block: folded.unbounded_density(block)[0], blocks)))

    always = evaluate(slice(0, grid.always))
    densities[grid.corner[: grid.always]] = always
    if bool((always[grid.likely :] > limit).any()):
        densities[grid.corner[grid.always :]] = evaluate(slice(grid.always, None))
    return densities.reshape(CELLS + 1, CELLS + 1, CELLS + 1)


def without_pieces(
    densities: Float[Tensor, "corners corners corners"], model: Model
) -> Float[Tensor, "corners corners corners"]:
    """Return densities without the small pieces that lie apart: crumbs, which the network leaves around an object."""
    from scipy.ndimage import label

    joined = max_of_corners(densities) * float((2 * model.extent_tensor / CELLS).amin()) > _JOINED
    labels, count = label(joined.cpu().numpy(), np.ones((3, 3, 3)))
    if count < 2:
        return densities
    sizes = np.bincount(labels.ravel())
    is_small = torch.from_numpy(sizes < _PIECE * sizes[1:].sum())
    is_small[0] = False
    pieces = is_small[torch.from_numpy(labels)].to(densities.device)
    dropped = corners_of(with_neighbours(pieces)) & ~corners_of(joined & ~pieces)
    return densities.masked_fill(dropped, 0.0)


def _moved_densities(folded: FoldedField, unmoved: Occupancy, edit: Edit) -> Float[Tensor, "corners corners corners"]:
    """Return densities at corners of the cells that an edit leads to an occupied cell or beside one; 0 elsewhere."""
    indices = torch.cartesian_prod(*[torch.arange(CELLS, device=unmoved.cell.device)] * 3)
    origins = edit.origins(unmoved.points_in(indices, 1))
    cells = contains(with_neighbours(unmoved.cells)[None], origins[None], unmoved.extent).view_as(unmoved.cells)
    rows = corners_of(cells).flatten().nonzero()[:, 0]
    points = corner_points(unmoved.extent, CELLS)
    return _densities_at(folded, rows, rows, lambda block: folded.first_layer(points.index_select(0, block)))


def _densities_at(
    folded: FoldedField,
    rows: Int[Tensor, "rows"],
    corners: Int[Tensor, "rows"],
    activations: Callable[[Int[Tensor, "block"]], Float[Tensor, "block width"]],
) -> Float[Tensor, "corners corners corners"]:
    """Return densities at corners, given as indices row by row; 0 at the others.

    Args:
        rows: of the corners, arguments of ``activations``, which returns outputs of the first layer.
    """

    def evaluate(block: Int[Tensor, "block"]) -> Float[Tensor, "block"]:
        return folded.unbounded_density(activations(pad_rows(block)))[0][: len(block)]

    densities = torch.zeros((CELLS + 1) ** 3, device=rows.device)
    densities[corners] = torch.cat(list(map_pieces(evaluate, rows.split(_BLOCK))))
    return densities.reshape(CELLS + 1, CELLS + 1, CELLS + 1)


@lru_cache(maxsize=1)  # 53 MB, and a fraction of a second
def _corners(model: Model, dtype: torch.dtype) -> _Corners:
    """Return a model's corners and their activations in a number format."""
    likely = torch.ones((CELLS + 1,) * 3, dtype=torch.bool, device=model.device)
    if model.stored_cells is not None:  # those of training objects
        likely = corners_of(divide(model.stored_cells.to(model.device), CELLS // STORED_CELLS))
    second = torch.zeros_like(likely)
    second[::2, ::2, ::2] = True
    fourth = torch.zeros_like(likely)
    fourth[::4, ::4, ::4] = True
    turn = torch.where(likely, 0, torch.where(second, 1, 2)).flatten()
    corner = turn.argsort(stable=True)
    points = corner_points(model.extent_tensor, CELLS)[corner]
    folded = FoldedField(model.mean)
    assert folded.dtype == dtype
    with torch.inference_mode():
        activations = torch.cat([folded.first_layer(block) for block in points.split(_BLOCK)])
    sparse = torch.where(likely, second, fourth).flatten()
    return _Corners(corner, activations, int((turn == 0).sum()), int((turn < 2).sum()), sparse)
