"""Cameras around the object as lines in a plane: plain projection, no renderer. Pure."""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float

from core.geometry.camera import Camera, camera_rotation

_LENGTH = 0.3  # scene units, length of a drawn frustum
_EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))


class OverviewCamera(NamedTuple):
    """Direction of the overview, without perspective; rad."""

    azimuth: float = math.radians(25)
    elevation: float = math.radians(35)

    def turned(self, across: float, down: float) -> "OverviewCamera":
        """Rotate by these angles, never below the horizontal plane."""
        return OverviewCamera(self.azimuth - across, max(0.0, min(math.pi / 2, self.elevation + down)))

    def project(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Project world points to the plane, x right and y down, in scene units."""
        right, up, _ = _axes(self.azimuth, self.elevation)
        return np.stack((points @ right, -(points @ up)), -1)


def frustum(camera: Camera) -> Float[np.ndarray, "lines 2 3"]:
    """Return a camera's viewing pyramid, its apex at the camera: eight lines."""
    right, up, back = _axes(camera.azimuth, camera.elevation)
    half = _LENGTH * np.array((camera.width, camera.height)) / (2 * camera.focal)
    apex = camera.distance * back
    corners = [
        apex - _LENGTH * back + x * half[0] * right + y * half[1] * up for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return np.stack((apex, *corners))[np.array(_EDGES)]


def box(extent: tuple[float, float, float]) -> Float[np.ndarray, "lines 2 3"]:
    """Return the object's box: twelve lines.

    Args:
        extent: half its sides, scene units.
    """
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * extent
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]
    return corners[np.array(pairs)]


def ring(radius: float, lines: int = 48) -> Float[np.ndarray, "lines 2 3"]:
    """Return a circle in the horizontal plane."""
    angles = np.linspace(0, 2 * math.pi, lines + 1)
    points = radius * np.stack((np.cos(angles), np.sin(angles), 0 * angles), -1)
    return np.stack((points[:-1], points[1:]), 1)


def _axes(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return right, up and backward like :func:`core.geometry.camera.camera_rotation`."""
    right, up, backward = camera_rotation(*torch.tensor([azimuth, elevation], dtype=torch.float64)).numpy()
    return right, up, backward
