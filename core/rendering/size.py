"""The size of an object in centimetres, and the stretch of space that gives it another one.

A photo shows no scale, and all objects of a model have one size. So the natural size of an object is that of its
surface's bounds, the longest side being as long as a typical one of the category (:attr:`Model.metres`). Another size
stretches space along the axes (:attr:`core.models.codes.Codes.stretch`), which cannot break an object.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.geometry.camera import Factors
from core.models.codes import MAX_DISTORTION, STRETCH
from core.models.model import Instance
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS, Occupancy, shape_occupancy

Size = tuple[float, float, float]  # cm: width, depth and height, along x, y and z
LIMITS = 0.1, 100_000.0  # cm, of a side
_SOLID = math.log(2)  # optical depth of a cell along the longest side, from which a point is inside, as in meshes
_PER_SIDE = 2  # points along each side of a cell
_HALVINGS = 7  # of the distance between two such points: a ten thousandth of the object
_BLOCK = 4096  # points evaluated at a time


class Bounds(NamedTuple):
    """A box around a surface, scene units."""

    low: Factors
    high: Factors

    def stretched(self, stretch: Factors) -> "Bounds":
        """Return the box around the stretched surface."""
        low, high = ((end[0] * stretch[0], end[1] * stretch[1], end[2] * stretch[2]) for end in self)
        return Bounds(low, high)

    def size(self, metres: float) -> Size:
        """Return the sides in cm of a box whose longest side has a length in m."""
        sides = [end - start for start, end in zip(self.low, self.high, strict=True)]
        width, depth, height = (100 * metres * side / max(sides) for side in sides)
        return width, depth, height


def size_of(instance: Instance) -> Size:
    """Return the size of an object. Raises ``ValueError`` if it has no surface, and for M1 and M2."""
    factors = instance.codes.factors
    width, depth, height = (side * factor for side, factor in zip(natural_size(instance), factors, strict=True))
    return width, depth, height


def natural_size(instance: Instance) -> Size:
    """Return the size of an object that was not stretched; as :func:`size_of`."""
    return natural_bounds(instance).size(instance.model.metres)


def sized(instance: Instance, size: tuple[float, ...] | None) -> Instance:
    """Return an object stretched to a size; None: to its natural size.

    Args:
        size: width, depth and height in cm.

    Raises ``ValueError`` for a size that is no length or too far from the natural one, for an object without a surface,
    and for models that paint the background.

    Example:
        >>> import core
        >>> chair = core.sized(core.load_model("chairs")[3], (60.0, 58.0, 92.0))
        >>> [round(side, 6) for side in size_of(chair)]
        [60.0, 58.0, 92.0]
    """
    if size is None:
        return instance.natural
    if len(size) != 3 or not all(LIMITS[0] <= side <= LIMITS[1] for side in size):  # false for NaN
        raise ValueError(f"a size is three lengths from {LIMITS[0]:g} to {LIMITS[1]:g} cm, got {described(size)}")
    if instance.model.white_from_network:
        raise ValueError("objects of a model that paints the background have no size")
    natural = natural_size(instance)
    x, y, z = (side / usual for side, usual in zip(size, natural, strict=True))
    factors = sorted((x, y, z))
    if factors[0] < STRETCH[0] or factors[-1] > STRETCH[1] or factors[-1] > MAX_DISTORTION * factors[0]:
        raise ValueError(
            f"{described(size)} is too far from the natural {described(natural)}: sides differ by a factor of "
            f"{STRETCH[1]:g} at most, and not one by {MAX_DISTORTION:g} times as much as another"
        )
    return instance.changed(stretch=(x, y, z))


def with_side(stretch: Factors, axis: int, factor: float) -> Factors:
    """Return a stretch with another factor along an axis, as near to that as limits allow.

    Example:
        >>> with_side((1.0, 1.0, 1.0), 2, 40.0)
        (1.0, 1.0, 10.0)
    """
    factors = list(stretch)
    del factors[axis]
    least = max(STRETCH[0], max(factors) / MAX_DISTORTION)
    most = min(STRETCH[1], min(factors) * MAX_DISTORTION)
    factors.insert(axis, max(least, min(most, factor)))
    return factors[0], factors[1], factors[2]


def described(size: tuple[float, ...]) -> str:
    """Return a size in words.

    Example:
        >>> described((60.0, 58.24, 92.0))
        '60 x 58.2 x 92 cm'
    """
    return " x ".join(f"{side:.6g}" if abs(side) >= 1000 else f"{side:.3g}" for side in size) + " cm"


def natural_bounds(instance: Instance) -> Bounds:
    """Return the bounds of an object's surface in its own space; cached. Raises ``ValueError`` without a surface."""
    return _bounds(instance.natural)


@lru_cache(maxsize=64)
def _bounds(instance: Instance) -> Bounds:
    folded = FoldedField.of(instance)
    occupancy = shape_occupancy(instance)
    low, high = ([_end(folded, occupancy, axis, side) for axis in range(3)] for side in (-1, 1))
    return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))


@torch.inference_mode()
def _end(folded: FoldedField, occupancy: Occupancy, axis: int, side: int) -> float:
    """Return the coordinate at which the surface ends along an axis, at its lower (-1) or upper (1) side."""
    cells = occupancy.cells.nonzero()
    layers = cells[:, axis].unique()
    for layer in layers if side < 0 else layers.flip(0):
        points = _points_within(occupancy, cells[cells[:, axis] == layer])
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
    along = torch.zeros(3, device=points.device)
    along[axis] = side
    reached = 0.0
    for _ in range(_HALVINGS):
        step /= 2
        solid = _is_solid(folded, occupancy, points + (reached + step) * along)
        if bool(solid.any()):
            points = points[solid]
            reached += step
    return float(points[0, axis]) + side * reached


def _points_within(occupancy: Occupancy, cells: Int[Tensor, "cells 3"]) -> Float[Tensor, "points 3"]:
    steps = (torch.arange(_PER_SIDE, device=cells.device) + 0.5) / _PER_SIDE
    within = torch.cartesian_prod(steps, steps, steps)
    return ((cells[:, None] + within) * occupancy.cell - occupancy.extent).flatten(0, 1)


def _is_solid(folded: FoldedField, occupancy: Occupancy, points: Float[Tensor, "points 3"]) -> Tensor:
    interval = 2 * float(occupancy.extent.max()) / CELLS
    return torch.cat([folded.density(block)[0] * interval > _SOLID for block in points.split(_BLOCK)])
