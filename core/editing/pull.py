"""Pulls on a point of an object: the length in centimetres that a drag in the image changes, and how far."""

import math
from typing import NamedTuple

import torch

from core.editing.bounds import Bounds, portion_of
from core.editing.size import SIDES, lengths, shown_bounds
from core.geometry.camera import Camera
from core.models.model import Instance

Point = tuple[float, float, float]

_STEP = 0.01  # scene units over which a point's motion in the image is measured
_SHORT = 0.15  # motion of a point, relative to one across the line of sight, below which no drag can follow it
_NEAR_MIDDLE = 0.25  # of a length: a point nearer to the place that stays counts as this far away
_FEET = 0.25  # of a height from its lower end: above it, a height grows upwards, as the object stands on the ground
_NEAREST = (0.1, 0.1, 0.4)  # of half a side: nearer to the middle, a point counts as this far out; any may be lifted
_LEAST = 0.01  # factor of a length in a drag


class Pull(NamedTuple):
    """A length that a drag changes.

    Example:
        >>> Pull("height", 90.0, (0.0, -0.05)).to((5.0, -10.0))
        135.0
    """

    name: str  # one of :func:`core.editing.size.lengths`
    length: float  # cm, when the drag begins
    growth: tuple[float, float]  # of the length, relative, per px right and down

    def to(self, drag: tuple[float, float]) -> float:
        """Return the length in cm after a drag (px right, px down)."""
        right, down = self.growth
        return self.length * max(_LEAST, 1 + right * drag[0] + down * drag[1])


def pull_on(instance: Instance, natural: Bounds, camera: Camera, name: str, point: Point) -> Pull | None:
    """Return the pull that moves a point with the hand; None if the camera sees its motion end on.

    Args:
        point: scene units as the camera sees them.
    """
    box = shown_bounds(instance, natural)
    axis = SIDES.index(name) if name in SIDES else 2
    portion = portion_of(instance.model)
    low = box.low[axis]
    side = box.high[axis] - low
    if portion and name == portion.name and box.plane is not None:
        low = low if portion.is_below else box.plane
        side = box.length(portion) / box.cm
    # An object grows around the scene's middle, so the lower end of a length moves by this much of its growth.
    rate = point[axis] - low + side * box.low[axis] / (box.high[axis] - box.low[axis])
    outwards = rate if axis < 2 else point[axis] - low - _FEET * side
    rate = math.copysign(max(abs(rate), _NEAR_MIDDLE * side), outwards)
    right, down = _motion(camera, axis, point)
    speed = math.hypot(right, down)
    if speed < _SHORT * camera.focal / camera.distance:
        return None
    growth = right / (speed**2 * rate), down / (speed**2 * rate)
    return Pull(name, lengths(instance, natural)[name], growth)


def find_pull(
    instance: Instance, natural: Bounds, camera: Camera, part: str, point: Point, drag: tuple[float, float]
) -> Pull | None:
    """Return the pull on a part that follows the axis of a drag: upwards it is the height, of legs their length.

    Args:
        point: where the surface is pulled, scene units as the camera sees them.
        drag: px, right and down.
    """
    box = shown_bounds(instance, natural)
    portion = portion_of(instance.model)
    names = [*SIDES]
    if portion and box.plane is not None and part in portion.pulled_parts:
        names[2] = portion.name

    def follows(axis: int) -> float:
        """Return how far an axis goes along the drag, weighted by the point's distance from the middle along it."""
        right, down = _motion(camera, axis, (0.0, 0.0, 0.0))
        out = abs(point[axis]) / (0.5 * (box.high[axis] - box.low[axis]))
        return max(_NEAREST[axis], out) * abs(right * drag[0] + down * drag[1])

    axis = max(range(3), key=follows)
    return pull_on(instance, natural, camera, names[axis], point)


def _motion(camera: Camera, axis: int, point: Point) -> tuple[float, float]:
    """Return the motion of a point in px, right and down, per scene unit along an axis."""
    ends = torch.tensor(point) + _STEP * torch.stack((torch.zeros(3), torch.eye(3)[axis]))
    right, down = (camera.project(ends).diff(dim=0)[0] / _STEP).tolist()
    return right, down
