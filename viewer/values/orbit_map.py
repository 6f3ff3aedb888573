"""Viewing directions as a disc: the top view in the middle, the horizon halfway out. Pure."""

import math
from dataclasses import replace

from core.geometry.camera import FRONT_AZIMUTH, Camera
from viewer.values.orbit import HIGHEST

HORIZON = 0.5  # radius, relative to the disc's


def place(camera: Camera) -> tuple[float, float]:
    """Return the camera's position on the disc of radius 1, x right and y down; the front is at the bottom."""
    radius = 0.5 - camera.elevation / math.pi
    angle = camera.azimuth - FRONT_AZIMUTH
    return radius * math.sin(angle), radius * math.cos(angle)


def moved_to(camera: Camera, x: float, y: float) -> Camera:
    """Move the camera to another position on the disc at the same distance."""
    elevation = math.pi * (0.5 - min(1.0, math.hypot(x, y)))
    azimuth = math.remainder(math.atan2(x, y) + FRONT_AZIMUTH, 2 * math.pi)
    return replace(camera, azimuth=azimuth, elevation=max(-HIGHEST, min(HIGHEST, elevation)))
