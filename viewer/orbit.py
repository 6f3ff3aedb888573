"""From the hand to a new camera: drag, wheel, keys. Pure."""

import math
from dataclasses import replace

from core.camera import Camera
from core.model import Model

_HIGHEST = math.radians(89.0)
"""Short of the pole, where the picture would spin."""
_ZOOM_STEP = 1.1
_NEAREST, _FARTHEST = 0.4, 3.0
"""Shares of the distance the model was trained at."""


def home(model: Model) -> Camera:
    """Where a model is first seen from: the front, a little from the side and above, near enough to fill the view."""
    half_view = math.atan(model.image_size / 2 / model.focal)
    # Four fifths: the box's corners are empty, so a little less than all of it fills the view.
    filling_it = 0.8 * math.hypot(*model.extent) / math.sin(half_view)
    return model.camera(math.radians(60), math.radians(20), min(model.distance, filling_it))


def dragged(camera: Camera, across: float, down: float) -> Camera:
    """The object turns with the hand: half a turn for a drag across the whole view.

    Args:
        across, down: how far the hand moved, in shares of the view's size.
    """
    return turned(camera, -math.pi * across, math.pi * down)


def turned(camera: Camera, azimuth: float, elevation: float) -> Camera:
    """The camera moved by these angles (rad), kept off the poles."""
    around = math.remainder(camera.azimuth + azimuth, 2 * math.pi)
    up = max(-_HIGHEST, min(_HIGHEST, camera.elevation + elevation))
    return replace(camera, azimuth=around, elevation=up)


def zoomed(camera: Camera, steps: float, model: Model) -> Camera:
    """Nearer by so many clicks of the wheel, neither into the object nor out of sight."""
    distance = camera.distance * _ZOOM_STEP**-steps
    return replace(camera, distance=max(_NEAREST * model.distance, min(_FARTHEST * model.distance, distance)))


def filling(camera: Camera, width: int, height: int, detail: int) -> Camera:
    """The view for a panel of any shape: its shorter side shows what the camera's height shows.

    Args:
        width, height: of the panel, px.
        detail: px along the shorter side of the picture.
    """
    shorter = max(1, min(width, height))
    across, down = (max(1, round(detail * side / shorter)) for side in (width, height))
    return replace(camera, focal=camera.focal * detail / camera.height, width=across, height=down)
