"""New cameras from input: drag, wheel, keys. Pure."""

import math
from dataclasses import dataclass, replace

from core.geometry.camera import FRONT_AZIMUTH, Camera
from core.models.model import Model
from core.rendering.progressive import Frame

HIGHEST = math.radians(89.0)  # short of the pole, where the image would spin
_ZOOM_STEP = 1.06
REACH = 0.4, 3.0  # nearest and farthest distance, relative to the training distance
VIEWS = {"front": (FRONT_AZIMUTH, 0.0), "side": (FRONT_AZIMUTH - math.pi / 2, 0.0), "top": (FRONT_AZIMUTH, HIGHEST)}
"""Azimuth and elevation (rad) of the standard views."""
_MAX_PAN = 1.0  # largest pan of the object, relative to the view's shorter side


def home(model: Model) -> Camera:
    """Return the initial camera of a model: from the front, slightly sideways and above, filling the view."""
    half_view = math.atan(model.image_size / 2 / model.focal)
    # Four fifths, because the box's corners are empty.
    filling_it = 0.8 * math.hypot(*model.extent) / math.sin(half_view)
    return model.camera(math.radians(60), math.radians(20), min(model.distance, filling_it))


def dragged(camera: Camera, across: float, down: float) -> Camera:
    """Rotate the object with the mouse: half a turn for a drag across the whole view.

    Args:
        across, down: motion of the mouse, relative to the view's size.
    """
    return turned(camera, -math.pi * across, math.pi * down)


def turned(camera: Camera, azimuth: float, elevation: float) -> Camera:
    """Rotate the camera by these angles (rad), kept off the poles."""
    around = math.remainder(camera.azimuth + azimuth, 2 * math.pi)
    up = max(-HIGHEST, min(HIGHEST, camera.elevation + elevation))
    return replace(camera, azimuth=around, elevation=up)


def reach(camera: Camera, model: Model) -> tuple[float, float]:
    """Return the least and the largest distance of a camera; longer focal lengths allow larger distances."""
    longer = max(1.0, camera.focal / camera.height / (model.focal / model.image_size))
    return REACH[0] * model.distance, REACH[1] * longer * model.distance


def zoomed(camera: Camera, steps: float, model: Model) -> Camera:
    """Zoom in by wheel clicks, within :func:`reach`."""
    nearest, farthest = reach(camera, model)
    return replace(camera, distance=max(nearest, min(farthest, camera.distance * _ZOOM_STEP**-steps)))


def seen_from(camera: Camera, view: str) -> Camera:
    """Return one of :data:`VIEWS` at the current distance."""
    azimuth, elevation = VIEWS[view]
    return replace(camera, azimuth=azimuth, elevation=elevation)


def same_direction(one: Camera, other: Camera) -> bool:
    """True if both cameras see the object from the same side, at any distance."""
    return (one.azimuth, one.elevation) == (other.azimuth, other.elevation)


def photo_camera(photo: Camera, model: Model) -> Camera:
    """The camera of a photo at the size of a model's images, the photo filling four fifths of a view."""
    size = model.image_size
    focal = 0.8 * photo.focal * size / max(photo.width, photo.height)
    return replace(photo, width=size, height=size, focal=focal)


def photo_box(
    photo: Camera, seen: Camera, panel: tuple[float, float], pan: tuple[float, float]
) -> tuple[float, float, float, float] | None:
    """Left, top, right and bottom (px) of a photo over a panel that shows it from its camera; None from elsewhere.

    Args:
        pan: as :func:`fit_to_panel` takes it.
    """
    if not same_direction(photo, seen) or not math.isclose(photo.distance, seen.distance):
        return None
    shorter = min(panel)
    x, y = (side / 2 + shorter * share for side, share in zip(panel, pan, strict=True))
    across, down = (seen.focal / seen.height * shorter / photo.focal * side / 2 for side in (photo.width, photo.height))
    return x - across, y - down, x + across, y + down


def panned(pan: tuple[float, float], across: float, down: float) -> tuple[float, float]:
    """Move the object in the view; fractions of the view's shorter side."""
    x, y = (max(-_MAX_PAN, min(_MAX_PAN, value)) for value in (pan[0] + across, pan[1] + down))
    return x, y


@dataclass(frozen=True)
class PanelCrop:
    """An image to render and the part of it that a panel shows: cameras only look at the object's middle."""

    camera: Camera
    width: int
    height: int  # px shown
    left: int = 0
    top: int = 0  # px to the left of and above the shown part

    def cropped(self, frame: Frame) -> Frame:
        """Crop a frame of any resolution to the shown part."""
        if (self.width, self.height) == (self.camera.width, self.camera.height):
            return frame
        scale = frame.image.shape[0] / self.camera.height
        height, width = (max(1, round(scale * size)) for size in (self.height, self.width))
        top = min(round(scale * self.top), frame.image.shape[0] - height)
        left = min(round(scale * self.left), frame.image.shape[1] - width)
        rows, columns = slice(top, top + height), slice(left, left + width)
        image, depth, opacity = (part[rows, columns] for part in (frame.image, frame.depth, frame.opacity))
        evaluations = None if frame.evaluations is None else frame.evaluations[rows, columns]
        return replace(frame, image=image, depth=depth, opacity=opacity, evaluations=evaluations)


def fit_to_panel(
    camera: Camera, width: int, height: int, detail: int, pan: tuple[float, float] = (0.0, 0.0)
) -> PanelCrop:
    """Return the view for a panel of any shape; its shorter side shows the camera's height.

    Args:
        width, height: of the panel, px.
        detail: px along the shorter side of the shown part.
        pan: shift of the object to the right and down, relative to the shorter side.
    """
    shorter = max(1, min(width, height))
    across, down = (max(1, round(detail * side / shorter)) for side in (width, height))
    right, below = (round(detail * share) for share in pan)
    full = across + 2 * abs(right), down + 2 * abs(below)
    full_camera = replace(camera, focal=camera.focal * detail / camera.height, width=full[0], height=full[1])
    return PanelCrop(full_camera, across, down, abs(right) - right, abs(below) - below)
