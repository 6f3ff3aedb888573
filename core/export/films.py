"""The views of a film around an object: a turn, a swing, or a morph into another object and back."""

import math
from dataclasses import replace
from typing import NamedTuple

from core.geometry.camera import Camera
from core.models.model import Instance

TURN, SWING = 72, 96  # usual frames of a turn, and of a swing to both sides
_SWING_ANGLE = math.radians(70.0)  # to either side of a photo's camera: further round, the photo shows little


class View(NamedTuple):
    """An object and a camera."""

    instance: Instance
    camera: Camera


def turntable(instance: Instance, camera: Camera, frames: int = TURN) -> list[View]:
    """Return the views of one full turn around the object, at the camera's elevation and distance.

    Raises ``ValueError`` without frames, as the other films do.
    """
    return [View(instance, _turned(camera, phase)) for phase in _phases(frames)]


def swing(instance: Instance, camera: Camera, frames: int = SWING) -> list[View]:
    """Return the views of a swing by 70 degrees to both sides of the camera, slow at either end; a loop has no seam.

    The way back has the views of the way there, the very same ones.
    """
    sines = [round(math.sin(phase), 9) for phase in _phases(frames)]
    return [View(instance, _turned(camera, _SWING_ANGLE * sine)) for sine in sines]


def morph(first: Instance, second: Instance, camera: Camera, frames: int = TURN) -> list[View]:
    """Return the views of one full turn in which the object becomes another one and itself again.

    Raises ``ValueError`` for an object of another model.
    """
    amounts = {phase: math.sin(phase / 2) ** 2 for phase in _phases(frames)}  # slow at either object
    return [View(first.mixed(second, amount, amount), _turned(camera, phase)) for phase, amount in amounts.items()]


def _phases(frames: int) -> list[float]:
    """Return the frames' phases of a loop, rad, 0 to 2 pi."""
    if frames < 1:
        raise ValueError(f"a film around an object needs at least 1 frame, got {frames}")
    return [2 * math.pi * index / frames for index in range(frames)]


def _turned(camera: Camera, angle: float) -> Camera:
    return replace(camera, azimuth=camera.azimuth + angle)
