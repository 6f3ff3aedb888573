"""Bounds of an object's surface, and the plane that divides its height: a chair's into legs and the rest."""

import math
from collections.abc import Iterable
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.edits.edit import Edit
from core.geometry.camera import Factors
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS, Occupancy, shape_occupancy
from core.rendering.surface import CELLS as SURFACE_CELLS
from core.rendering.surface import surface_points
from core.runtime.layers import pad_rows

Size = tuple[float, float, float]  # cm: width, depth and height, along x, y and z
_SOLID = math.log(2)  # optical depth of a cell along the longest side, from which a point is inside, as in meshes
_PER_SIDE = 2  # points along each side of a cell
_HALVINGS = 7  # of the distance between two such points: a ten thousandth of the object
_BLOCK = 4096  # points evaluated at a time
_LEAST_ROWS = 5  # rows of a part's surface, below which an object counts as without the part
_LEAST_SHARE = 0.08  # of an object's height: a plane nearer to an end divides nothing


class Portion(NamedTuple):
    """A portion of an object's height, below or above a plane."""

    name: str  # in options and in the window
    is_below: bool
    edge_of: str  # the part whose lower edge is the plane
    row_axes: tuple[int, ...]  # axes that number the rows of a surface; the lowest point of a row is at the edge
    pulled_parts: tuple[str, ...]  # parts whose handles change the portion


_PORTIONS = Portion("legs", True, "seat", (0, 1), ("legs",)), Portion("roof", False, "glass", (1,), ("glass",))


class Bounds(NamedTuple):
    """A box around a surface, scene units."""

    low: Factors
    high: Factors
    cm: float  # per scene unit
    plane: float | None = None  # height of the plane that divides the object; None: it has no such plane

    @property
    def size(self) -> Size:
        """The sides in cm."""
        width, depth, height = (self.cm * (end - start) for start, end in zip(self.low, self.high, strict=True))
        return width, depth, height

    def length(self, portion: Portion) -> float:
        """Return the length in cm of a portion of the object's height. Raises ``ValueError`` without a plane."""
        if self.plane is None:
            raise ValueError(f"the object has no {portion.name}")
        return self.cm * (self.plane - self.low[2] if portion.is_below else self.high[2] - self.plane)

    def in_units(self, unit: float) -> "Bounds":
        """Return the same box in units that are ``unit`` scene units long."""
        return self._with_ends(self._ends / unit)._replace(cm=self.cm * unit)

    def after(self, edits: Iterable[Edit]) -> "Bounds":
        """Return the box around the surface after edits of its size."""
        ends = self._ends
        for edit in edits:
            ends = edit.destinations(ends)
        return self._with_ends(ends)

    @property
    def _ends(self) -> Float[Tensor, "3 3"]:
        """Two corners, and a point of the plane."""
        return torch.tensor((*self.low, *self.high, 0.0, 0.0, self.plane or 0.0), dtype=torch.double).view(3, 3)

    def _with_ends(self, ends: Float[Tensor, "3 3"]) -> "Bounds":
        low, high, (_, _, plane) = ends.tolist()
        return Bounds(tuple(low), tuple(high), self.cm, None if self.plane is None else plane)


def portion_of(model: Model) -> Portion | None:
    """Return the portion of the height of a model's objects that can be sized; None if their parts give none."""
    names = model.part_head.names if model.part_head else ()
    return next((portion for portion in _PORTIONS if portion.edge_of in names), None)


def bounds_of(instance: Instance) -> Bounds:
    """Return the bounds of an object's surface in its size; as :func:`natural_bounds`."""
    return natural_bounds(instance).after(instance.codes.edits_of("size"))


def natural_bounds(instance: Instance) -> Bounds:
    """Return the bounds of an object's natural surface; cached. Raises ``ValueError`` without a surface."""
    return _bounds(instance.natural.with_texture(instance.model.mean))  # the texture does not matter


@lru_cache(maxsize=64)
def _bounds(instance: Instance) -> Bounds:
    folded = FoldedField.of(instance)
    occupancy = shape_occupancy(instance)
    low, high = ([_end(folded, occupancy, axis, side) for axis in range(3)] for side in (-1, 1))
    longest = max(end - start for start, end in zip(low, high, strict=True))
    plane = _plane(instance)
    divides = plane is not None and _LEAST_SHARE < (plane - low[2]) / (high[2] - low[2]) < 1 - _LEAST_SHARE
    cm = 100 * instance.model.metres / longest
    return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]), cm, plane if divides else None)


@torch.inference_mode()
def _plane(instance: Instance) -> float | None:
    """Return the height of the plane that divides an object: the median over a part's lower edge."""
    portion = portion_of(instance.model)
    if portion is None:
        return None
    is_of_part = partial(_is_of, instance, portion.edge_of)
    points = surface_points(instance)[0]
    points = points[is_of_part(points)]
    points = points[points[:, 2].argsort()]
    _, lowest = np.unique(points[:, portion.row_axes].cpu().numpy(), axis=0, return_index=True)
    if len(lowest) < _LEAST_ROWS:
        return None
    points = points[torch.from_numpy(lowest).to(points.device)]
    step = 2 * max(instance.model.extent) / SURFACE_CELLS
    for _ in range(_HALVINGS):
        step /= 2
        lower = points - points.new_tensor([0.0, 0.0, step])
        points = torch.where(is_of_part(lower)[:, None], lower, points)
    return float(points[:, 2].median())


def _is_of(instance: Instance, name: str, points: Float[Tensor, "points 3"]) -> Bool[Tensor, "points"]:
    """Mark the points inside a part."""
    head = instance.model.part_head
    assert head is not None
    density, features = FoldedField.of(instance).density(pad_rows(points))
    is_inside = density[: len(points)] * (2 * max(instance.model.extent) / CELLS) > _SOLID
    return is_inside & (head(features[: len(points)]).argmax(1) == head.names.index(name))


@torch.inference_mode()
def _end(folded: FoldedField, occupancy: Occupancy, axis: int, side: int) -> float:
    """Return the coordinate at which the surface ends along an axis, at its lower (-1) or upper (1) side."""
    cells = occupancy.cells.nonzero()
    layers = cells[:, axis].unique()
    for layer in layers if side < 0 else layers.flip(0):
        points = occupancy.points_in(cells[cells[:, axis] == layer], _PER_SIDE)
        inside = points[_is_solid(folded, occupancy, points)]
        if len(inside):
            return _refined(folded, occupancy, inside, axis, side)
    raise ValueError("the object has no surface: its density is too low everywhere")


def _refined(
    folded: FoldedField, occupancy: Occupancy, inside: Float[Tensor, "points 3"], axis: int, side: int
) -> float:
    """Return how far the surface reaches beyond the outermost of some inner points, by bisection."""
    points = inside[(side * inside[:, axis]) >= (side * inside[:, axis]).amax() - 1e-6]
    step = float(occupancy.cell[axis]) / _PER_SIDE
    axis_step = torch.zeros(3, device=points.device)
    axis_step[axis] = side
    reached = 0.0
    for _ in range(_HALVINGS):
        step /= 2
        solid = _is_solid(folded, occupancy, points + (reached + step) * axis_step)
        if bool(solid.any()):
            points = points[solid]
            reached += step
    return float(points[0, axis]) + side * reached


def _is_solid(folded: FoldedField, occupancy: Occupancy, points: Float[Tensor, "points 3"]) -> Tensor:
    interval = 2 * float(occupancy.extent.max()) / CELLS
    return torch.cat([folded.density(block)[0] * interval > _SOLID for block in points.split(_BLOCK)])
