"""Width, depth and height of an object, drawn on its picture as in a furniture catalogue.

The page draws the same lines (``drawDimensions`` in ``page_controls.js``).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from core.editing.bounds import Bounds, natural_bounds
from core.editing.size import shown_bounds
from core.export.films import View
from core.geometry.camera import Camera

UNITS = {"cm": 1.0, "in": 2.54}  # cm of each unit
ROOM = 0.8  # zoom that leaves room for the lines around an object that fills the frame
_GAP, _TICK, _TEXT, _WIDTH = 0.03, 0.012, 0.034, 0.003
"""fractions of the frame's shorter side: from box to line, from there to a tick's end, letters, width of a line"""
_PREFERENCE = np.array((1.0, 1.0, 0.9))  # of upright sides: two floor lines meet at the last one
_SHORTEST = 0.08  # fraction of the frame's shorter side; a side that is seen shorter than this gets no line
_FINE = 3  # pixels of the drawing along one of the image, for smooth lines
_DARK = (60, 60, 64, 255)  # lines on light ground
_LIGHT = (235, 235, 235, 255)  # lines on dark ground


class DimensionLine(NamedTuple):
    """A side of the box around an object, with its length."""

    ends: Float[np.ndarray, "2 2"]  # px, of the side
    outward: Float[np.ndarray, "2"]  # unit vector in the image, away from the object
    label: str


def with_room(views: Sequence[View]) -> list[View]:
    """Return views in which an object that filled the frame leaves room for its dimensions."""
    return [view._replace(camera=replace(view.camera, focal=ROOM * view.camera.focal)) for view in views]


def size_labels(box: Bounds, unit: str) -> tuple[str, str, str]:
    """Return width, depth and height of a box in a unit of :data:`UNITS`."""
    width, depth, height = (f"{side / UNITS[unit]:.{0 if unit == 'cm' else 1}f} {unit}" for side in box.size)
    return width, depth, height


def dimension_lines(box: Bounds, camera: Camera, unit: str) -> list[DimensionLine]:
    """Return the sides of a box to draw: two at the floor in front, and the upright one furthest to a side.

    Args:
        box: as the camera sees it, scene units.
    """
    low = np.array(box.low)
    high = np.array(box.high)
    origin = camera.world_to_camera(torch.device("cpu"))[1].numpy()
    centre = (low + high) / 2
    is_near = origin > centre
    near = np.where(is_near, high, low)
    far = np.where(is_near, low, high)
    floor = low[2]
    width = (far[0], near[1], floor), (near[0], near[1], floor)
    depth = (near[0], near[1], floor), (near[0], far[1], floor)
    corners = [(far[0], near[1]), (near[0], far[1]), (near[0], near[1])]
    uprights = [((x, y, floor), (x, y, high[2])) for x, y in corners]
    points = np.array([width, depth, *uprights, (centre, centre)], np.float32)
    pixels = camera.project(torch.from_numpy(points)).numpy()
    middle = pixels[-1, 0]
    reach = _PREFERENCE * np.abs(pixels[2:5].mean(1)[:, 0] - middle[0])
    sides = pixels[0], pixels[1], pixels[2 + int(reach.argmax())]
    labelled = zip(sides, size_labels(box, unit), strict=True)
    shortest = _SHORTEST * min(camera.width, camera.height)
    return [_line(ends, middle, label) for ends, label in labelled if np.linalg.norm(ends[1] - ends[0]) > shortest]


def _line(ends: Float[np.ndarray, "2 2"], middle: Float[np.ndarray, "2"], label: str) -> DimensionLine:
    x, y = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    outward = np.array((y, -x))
    return DimensionLine(ends, outward * (1 if outward @ (ends.mean(0) - middle) > 0 else -1), label)


def draw_dimensions(
    image: UInt8[np.ndarray, "height width channels"], view: View, unit: str
) -> UInt8[np.ndarray, "height width channels"]:
    """Return an image (RGB or RGBA) of a view with the object's dimensions, in a unit of :data:`UNITS`."""
    instance, camera = view
    box = shown_bounds(instance, natural_bounds(instance))
    side = _FINE * min(camera.width, camera.height)
    is_opaque = image.shape[2] == 3 or image[0, 0, 3] > 128
    colour = _LIGHT if is_opaque and image[0, 0, :3].mean() < 128 else _DARK
    layer = Image.new("RGBA", (_FINE * camera.width, _FINE * camera.height), (*colour[:3], 0))
    draw = ImageDraw.Draw(layer)
    font = ImageFont.load_default(_TEXT * side)
    for line in dimension_lines(box, camera, unit):
        for stroke in _strokes(line, side):
            draw.line([tuple(_FINE * point) for point in stroke], colour, max(_FINE, round(_WIDTH * side)))
        left, top, right, bottom = draw.textbbox((0, 0), line.label, font, anchor="mm")
        clear = _GAP * side + _TICK * side + abs(line.outward) @ (right - left, bottom - top) / 2
        draw.text(tuple(_FINE * line.ends.mean(0) + clear * line.outward), line.label, colour, font, anchor="mm")
    drawn = layer.resize((camera.width, camera.height), Image.Resampling.BOX)
    mode = "RGBA" if image.shape[2] == 4 else "RGB"
    return np.asarray(Image.alpha_composite(Image.fromarray(image).convert("RGBA"), drawn).convert(mode))


def _strokes(line: DimensionLine, side: float) -> Iterable[Float[np.ndarray, "2 2"]]:
    """Return a line beside the side of a box, and a tick at each end that points at the box."""
    gap, tick = (fraction * side / _FINE * line.outward for fraction in (_GAP, _TICK))
    yield line.ends + gap
    for end in line.ends:
        yield np.stack((end + gap / 3, end + gap + tick))
