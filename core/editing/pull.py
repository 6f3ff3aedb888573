"""Pulls on a point of the surface: the shape direction that a drag in the image follows, and how far it goes."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch

from core.editing.words import AXES
from core.geometry.camera import Camera
from core.models.model import Instance

_SPEED = 0.03  # of the image's height per standard deviation: about twice as far as the surface moves
_NEAREST = (0.1, 0.1, 0.4)  # of the box: nearer to its middle, a point counts as this far away; any may be lifted
_FEET = 0.5  # of the box below its middle: above it, an object grows upwards, as it stands on the ground


class Pull(NamedTuple):
    """A shape direction, and the motion of the hand along it."""

    direction: int  # index into :attr:`core.models.codes.CodeSpace.basis`
    motion: tuple[float, float]  # px per standard deviation, right and down

    def amount(self, drag: tuple[float, float]) -> float:
        """Return the standard deviations that best follow a drag (px right, px down).

        Example:
            >>> Pull(0, (0.0, -20.0)).amount((5.0, -10.0))
            0.5
        """
        right, down = self.motion
        return (right * drag[0] + down * drag[1]) / (right**2 + down**2)


def find_pull(
    instance: Instance,
    words: Sequence[str],
    camera: Camera,
    point: tuple[float, float, float],
    drag: tuple[float, float],
) -> Pull:
    """Return the pull whose word names the axis of a drag.

    A drag upwards at an object's top is *taller*. Sizes grow when the drag moves away from the object's middle. Without
    words for sizes it is the first direction.

    Args:
        words: of the shape directions (:func:`core.editing.words.direction_words`).
        point: where the surface is pulled, scene units.
        drag: px, right and down.
    """
    sizes = {AXES[word][0]: (index, AXES[word][1]) for index, word in reversed([*enumerate(words)]) if word in AXES}
    sizes = sizes or dict.fromkeys(range(3), (0, 1))
    middle, *ends = camera.project(torch.cat((torch.zeros(1, 3), 0.1 * torch.eye(3)))).tolist()
    axes = [(end[0] - middle[0], end[1] - middle[1]) for end in ends]
    outwards = [coordinate / half for coordinate, half in zip(point, instance.model.extent, strict=True)]
    outwards[2] += _FEET

    def follows(axis: int) -> float:
        """Return how far an axis goes along the drag, weighted by the point's distance from the middle along it."""
        along = axes[axis][0] * drag[0] + axes[axis][1] * drag[1]
        return max(_NEAREST[axis], abs(outwards[axis])) * abs(along)

    axis = max(sizes, key=follows)
    direction, sign = sizes[axis]
    right, down = axes[axis]
    speed = math.copysign(_SPEED * camera.height / max(math.hypot(right, down), 1e-6), sign * outwards[axis])
    return Pull(direction, (speed * right, speed * down))
