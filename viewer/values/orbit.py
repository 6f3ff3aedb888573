"""Cameras after a drag, a wheel click or a key, and their crops to the view's size."""

import math
from dataclasses import dataclass, replace

from core.detail.progressive import Frame
from core.geometry.camera import FRONT_AZIMUTH, Camera
from core.models.model import Model

HIGHEST = math.radians(89.0)  # largest elevation, rad: at the pole the image would spin
_ZOOM_STEP = 1.06  # factor of the distance per wheel click
REACH = 0.4, 3.0  # nearest and farthest distance, relative to the training distance
VIEWS = {"front": (FRONT_AZIMUTH, 0.0), "side": (FRONT_AZIMUTH - math.pi / 2, 0.0), "top": (FRONT_AZIMUTH, HIGHEST)}
"""Azimuth and elevation (rad) of the standard views."""
_MAX_PAN = 1.0  # largest pan of the object, relative to the view's shorter side


def home(model: Model) -> Camera:
    """Return a model's initial camera: from the front, slightly sideways and above, the object filling the view."""
    half_view = math.atan(model.image_size / 2 / model.focal)
    # Four fifths, because the box's corners are empty.
    filling_it = 0.8 * math.hypot(*model.extent) / math.sin(half_view)
    return model.camera(math.radians(60), math.radians(20), min(model.distance, filling_it))


def dragged(camera: Camera, across: float, down: float) -> Camera:
    """Return the camera after a drag by fractions of the view's size; one across the whole view is half a turn."""
    return turned(camera, -math.pi * across, math.pi * down)


def turned(camera: Camera, azimuth: float, elevation: float) -> Camera:
    """Return the camera turned by these angles (rad), kept off the poles."""
    around = math.remainder(camera.azimuth + azimuth, 2 * math.pi)
    up = max(-HIGHEST, min(HIGHEST, camera.elevation + elevation))
    return replace(camera, azimuth=around, elevation=up)


def reach(camera: Camera, model: Model) -> tuple[float, float]:
    """Return a camera's least and largest distance in scene units; a longer focal length allows a larger one."""
    longer = max(1.0, camera.focal / camera.height / (model.focal / model.image_size))
    return REACH[0] * model.distance, REACH[1] * longer * model.distance


def zoomed(camera: Camera, steps: float, model: Model) -> Camera:
    """Return the camera nearer by wheel clicks, farther for negative ``steps``, within :func:`reach`."""
    return at_distance(camera, camera.distance * _ZOOM_STEP**-steps, model)


def at_distance(camera: Camera, distance: float, model: Model) -> Camera:
    """Return the camera at a distance in scene units, or as near to it as :func:`reach` allows."""
    nearest, farthest = reach(camera, model)
    return replace(camera, distance=max(nearest, min(farthest, distance)))


def seen_from(camera: Camera, view: str) -> Camera:
    """Return the camera of a standard view (:data:`VIEWS`) at the current distance."""
    azimuth, elevation = VIEWS[view]
    return replace(camera, azimuth=azimuth, elevation=elevation)


def same_direction(first: Camera, second: Camera) -> bool:
    """Return whether both cameras see the object from the same side, at any distance."""
    return (first.azimuth, first.elevation) == (second.azimuth, second.elevation)


def photo_camera(photo: Camera, model: Model) -> Camera:
    """Return a photo's camera at the size of a model's images, where the photo fills four fifths."""
    size = model.image_size
    focal = 0.8 * photo.focal * size / max(photo.width, photo.height)
    return replace(photo, width=size, height=size, focal=focal)


def photo_box(
    photo: Camera, view: Camera, panel: tuple[float, float], pan: tuple[float, float]
) -> tuple[float, float, float, float] | None:
    """Return a photo's left, top, right and bottom (px) in a panel; None unless seen from its camera.

    Args:
        photo: camera of the photo.
        view: camera of the panel.
        panel: width and height in px.
        pan: shift of the object, as in :func:`fit_to_panel`.
    """
    if not same_direction(photo, view) or not math.isclose(photo.distance, view.distance):
        return None
    shorter = min(panel)
    x, y = (side / 2 + shorter * shift for side, shift in zip(panel, pan, strict=True))
    dx, dy = (view.focal / view.height * shorter / photo.focal * side / 2 for side in (photo.width, photo.height))
    return x - dx, y - dy, x + dx, y + dy


def panned(pan: tuple[float, float], across: float, down: float) -> tuple[float, float]:
    """Return the pan moved right and down, limited, as fractions of the view's shorter side."""
    x, y = (max(-_MAX_PAN, min(_MAX_PAN, value)) for value in (pan[0] + across, pan[1] + down))
    return x, y


@dataclass(frozen=True)
class PanelCrop:
    """An image to render and the part of it that a panel shows.

    The image is larger than the part if the object is off the panel's middle, as cameras look at the object.
    """

    camera: Camera  # of the whole image
    width: int  # px shown
    height: int  # px shown
    left: int = 0  # px to the left of the shown part
    top: int = 0  # px above the shown part

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the shown part, as fractions of the whole image's width and height."""
        width = self.camera.width
        height = self.camera.height
        return self.left / width, self.top / height, (self.left + self.width) / width, (self.top + self.height) / height

    def cropped(self, frame: Frame) -> Frame:
        """Crop a frame of the whole image, at any resolution, to the shown part."""
        if (self.width, self.height) == (self.camera.width, self.camera.height):
            return frame
        scale = frame.image.shape[0] / self.camera.height
        height, width = (max(1, round(scale * size)) for size in (self.height, self.width))
        top = min(round(scale * self.top), frame.image.shape[0] - height)
        left = min(round(scale * self.left), frame.image.shape[1] - width)
        rows = slice(top, top + height)
        columns = slice(left, left + width)
        image, depth, opacity = (array[rows, columns] for array in (frame.image, frame.depth, frame.opacity))
        evaluations = None if frame.evaluations is None else frame.evaluations[rows, columns]
        return replace(frame, image=image, depth=depth, opacity=opacity, evaluations=evaluations)


def fit_to_panel(
    camera: Camera, width: int, height: int, detail: int, pan: tuple[float, float] = (0.0, 0.0)
) -> PanelCrop:
    """Return the image to render for a panel of any shape; its shorter side shows the camera's height.

    Args:
        width, height: of the panel, px.
        detail: px along the shorter side of the shown part.
        pan: shift of the object to the right and down, as fractions of the shorter side.
    """
    shorter = max(1, min(width, height))
    columns, rows = (max(1, round(detail * side / shorter)) for side in (width, height))
    right, below = (round(detail * shift) for shift in pan)
    full = columns + 2 * abs(right), rows + 2 * abs(below)
    full_camera = replace(camera, focal=camera.focal * detail / camera.height, width=full[0], height=full[1])
    return PanelCrop(full_camera, columns, rows, abs(right) - right, abs(below) - below)
