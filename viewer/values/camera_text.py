"""A camera as a line of text for the clipboard."""

import math
import re
from dataclasses import replace
from typing import Any

from core.geometry.camera import Camera

_NUMBER = re.compile(r"(azimuth|elevation|distance|focal)\s*[=:]?\s*(-?\d+(?:\.\d+)?(?:e-?\d+)?)", re.IGNORECASE)


def camera_text(camera: Camera) -> str:
    """Format a camera: angles in degrees, distance in scene units, focal length in image heights.

    Example:
        >>> camera_text(Camera(math.pi / 3, 0.25, 2.0, 131.25, 128, 128))
        'azimuth=60.0000 elevation=14.3239 distance=2.00000 focal=1.02539'
    """
    azimuth, elevation = math.degrees(camera.azimuth), math.degrees(camera.elevation)
    focal = camera.focal / camera.height
    return f"azimuth={azimuth:.4f} elevation={elevation:.4f} distance={camera.distance:.5f} focal={focal:.5f}"


def camera_from_text(text: str, camera: Camera) -> Camera:
    """Return ``camera`` with the values that a text names. Raises ``ValueError`` if it names none."""
    found: dict[str, Any] = {name.lower(): float(value) for name, value in _NUMBER.findall(text)}
    if not found:
        raise ValueError("there is no camera in the clipboard, such as azimuth=60 elevation=20 distance=2")
    for name in ("azimuth", "elevation"):
        if name in found:
            found[name] = math.radians(found[name])
    if "focal" in found:
        found["focal"] *= camera.height
    return replace(camera, **found)
