"""View modes: a frame's colours, depth, normals, opacity, samples or sources of colours."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, UInt8

from core.detail.progressive import Frame
from core.geometry.camera import Camera, camera_directions, camera_rotation, pixel_centres
from core.geometry.pixels import to_bytes

_OPAQUE = 0.5  # opacity from which a pixel counts as the object
_COLOUR_MAP = np.array([[13, 8, 60], [120, 28, 109], [229, 92, 48], [252, 200, 65], [252, 255, 190]])
"""Colours of 0 to 1, at equal steps."""

SOURCE_COLOURS = {
    name: np.array(colour, np.float32)
    for name, colour in (("photo", (50, 190, 90)), ("mirrored", (60, 120, 240)), ("model", (150, 150, 150)))
}  # of pixels from a photo, from its mirror image, and from the model alone


def in_mode(frame: Frame, camera: Camera, mode: str) -> Frame:
    """Return the frame of a camera with its image in a mode of :data:`MODES`; unchanged if it lacks the data."""
    image = MODES[mode](frame, camera)
    if image is None:
        return frame
    opacity = np.ones_like(frame.opacity) if mode in _WITHOUT_BACKGROUND else frame.opacity
    return replace(frame, image=image, opacity=opacity)


def colour_map(values: Float[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape 3"]:
    """Map numbers in 0..1 to colours from dark to bright."""
    steps = np.linspace(0, 1, len(_COLOUR_MAP))
    channels = [np.interp(values, steps, _COLOUR_MAP[:, channel]) for channel in range(3)]
    return (np.stack(channels, -1) + 0.5).astype(np.uint8)


def normals(frame: Frame, camera: Camera) -> Float[np.ndarray, "height width 3"]:
    """Return unit normals in world axes from a frame's depth; 0 off the object and at its edges.

    Differences of neighbouring pixels give the normals, so a coarse frame has coarse ones.
    """
    height, width = frame.depth.shape
    view = camera.resized(width, height)
    centres = pixel_centres(width, height).double()
    points = frame.depth[..., None] * camera_directions(centres, view.focal, (width, height)).numpy()
    is_object = frame.opacity > _OPAQUE
    inner = is_object.copy()
    inner[1:-1, 1:-1] &= is_object[:-2, 1:-1] & is_object[2:, 1:-1] & is_object[1:-1, :-2] & is_object[1:-1, 2:]
    inner[[0, -1]] = inner[:, [0, -1]] = False
    horizontal = np.zeros_like(points)
    down = np.zeros_like(points)
    horizontal[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    facing = np.cross(down, horizontal)
    length = np.linalg.norm(facing, axis=-1, keepdims=True)
    angles = torch.tensor([camera.azimuth, camera.elevation], dtype=torch.float64)
    to_camera = camera_rotation(angles[0], angles[1]).numpy()
    return np.where(inner[..., None], facing / np.maximum(length, 1e-12), 0.0) @ to_camera


def _depth(frame: Frame, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Show depth within the object's range; bright is near."""
    is_object = frame.opacity > _OPAQUE
    if not is_object.any():
        return np.full_like(frame.image, 255)
    near = frame.depth[is_object].min()
    far = frame.depth[is_object].max()
    nearness = 1 - (frame.depth - near).clip(0, far - near) / max(far - near, 1e-6)
    return _on_white(frame, colour_map(0.1 + 0.9 * nearness.astype(float)))


def _opacity(frame: Frame, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Show opacity from black to white."""
    grey = to_bytes(frame.opacity)
    return np.repeat(grey[..., None], 3, -1)


def _normal(frame: Frame, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Show the world axes of normals as red, green and blue."""
    directions = normals(frame, camera)
    colours = np.where(directions.any(-1, keepdims=True), 127.5 * (directions + 1) + 0.5, 255.0)
    return _on_white(frame, colours.clip(0, 255).astype(np.uint8))


def _samples(frame: Frame, camera: Camera) -> UInt8[np.ndarray, "height width 3"] | None:
    """Show the number of evaluated samples per ray, relative to the largest; None if unknown."""
    if frame.evaluations is None:
        return None
    return colour_map(frame.evaluations / max(1, int(frame.evaluations.max())))


def _source(frame: Frame, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Show sources of colours: green from a photo, blue from its mirror image, grey from the model."""
    light = frame.image.astype(np.float32).mean(-1, keepdims=True)
    shares = np.zeros((*frame.opacity.shape, 2), np.float32) if frame.sources is None else frame.sources
    photo, mirrored = (shares / np.maximum(frame.opacity, 1e-3)[..., None]).clip(0, 1).transpose(2, 0, 1)[..., None]
    tint = photo * SOURCE_COLOURS["photo"] + mirrored * SOURCE_COLOURS["mirrored"]
    tint = tint + (1 - photo - mirrored).clip(0, 1) * SOURCE_COLOURS["model"]
    return _on_white(frame, (0.45 * light + 0.55 * tint).clip(0, 255).astype(np.uint8))


def _on_white(frame: Frame, colours: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "height width 3"]:
    opacity = frame.opacity.clip(0, 1)[..., None]
    return (opacity * colours + 255 * (1 - opacity) + 0.5).astype(np.uint8)


MODES: dict[str, Callable[[Frame, Camera], np.ndarray | None]] = {
    "colour": lambda frame, camera: None,  # the frame's own image
    "depth": _depth,
    "normals": _normal,
    "opacity": _opacity,
    "samples": _samples,
    "source": _source,
}
_WITHOUT_BACKGROUND = ("opacity", "samples")  # modes whose images cover the background
