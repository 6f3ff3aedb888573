"""A box around the object in the view, with handles for its sides and for legs or roof."""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import torch
from imgui_bundle import ImVec2, hello_imgui, imgui

from core.editing.bounds import Bounds, portion_of
from core.editing.pull import Point, Pull, pull_on
from core.editing.size import SIDES, shown_bounds
from core.geometry.camera import Camera
from core.models.model import Instance
from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, packed
from viewer.widgets.controls import end_gesture
from viewer.widgets.text import paint_on_plate

_EDGES = [(a, b) for a in range(8) for b in range(a) if (a ^ b).bit_count() == 1]  # of corners whose bits are x, y, z
_RADIUS = 0.42  # em, of a handle


class _Grip(NamedTuple):
    """A place in the view that is dragged to change a length."""

    key: str  # of the widget
    middle: ImVec2  # px on screen
    pull: Pull


def draw_size_box(context: PanelContext, corner: ImVec2, size: ImVec2, is_hinted: bool) -> None:
    """Draw the box over the view, if it is hinted at or the tool *size*, which has handles, too."""
    natural = context.session.reshaping.bounds
    if context.session.viewport.source != "scene" or natural is None:
        return
    is_tool = context.tool == "size"
    projection = _Projection.of(context, corner, size)
    instance = context.session.editor.scene.instance
    if is_tool or is_hinted:
        _draw_edges(context, projection, shown_bounds(instance, natural))
    for grip in _grips(instance, natural, projection) if is_tool else ():
        _draw_grip(context, grip, projection.scale)


def _draw_grip(context: PanelContext, grip: _Grip, scale: float) -> None:
    """Draw a handle; ``scale`` is in px on screen per px of the image."""
    radius = hello_imgui.em_size(_RADIUS)
    imgui.set_cursor_screen_pos(grip.middle - ImVec2(1.5 * radius, 1.5 * radius))
    imgui.invisible_button(f"##size {grip.key}", (3 * radius, 3 * radius))
    if imgui.is_item_active() and any(imgui.get_io().mouse_delta):
        drag = imgui.get_mouse_drag_delta(0, 0.0) / scale
        context.session.reshaping.drag_length(grip.pull, (drag.x, drag.y))
    end_gesture(context)
    active = imgui.is_item_hovered() or imgui.is_item_active()
    draw = imgui.get_window_draw_list()
    draw.add_circle_filled(grip.middle, radius * (1.3 if active else 1.0), packed(context.palette.accent))
    draw.add_circle(grip.middle, radius * (1.3 if active else 1.0), packed(ON_PLATE), thickness=1.5)
    length = f"{grip.pull.length:.3g} cm"
    words = f"{grip.pull.name.capitalize()} {length}" if active else length
    low = grip.middle + ImVec2(2 * radius, -imgui.get_text_line_height() / 2)
    paint_on_plate(low, words, ImVec2(0.3, 0.1) * hello_imgui.em_size())


def _grips(instance: Instance, natural: Bounds, projection: "_Projection") -> list[_Grip]:
    """Return the handles of the top, of the sides that face the camera, and of the plane at its right."""
    box = shown_bounds(instance, natural)
    right, _, _, eye = projection.camera.pose()[:3].T.tolist()
    middle = [(low + high) / 2 for low, high in zip(box.low, box.high, strict=True)]
    handles = dict[str, tuple[str, Point]]()
    for axis, name in enumerate(SIDES):
        for outwards, end in ((-1, box.low), (1, box.high)):
            is_top = (axis, outwards) == (2, 1)
            if is_top or outwards * (eye[axis] - end[axis]) > 0:
                face = [*middle[:axis], end[axis], *middle[axis + 1 :]]
                handles[f"{axis} {outwards}"] = name, (face[0], face[1], face[2])
    portion = portion_of(instance.model)
    if portion and box.plane is not None:
        point = max(_ring(box), key=lambda corner: right[0] * corner[0] + right[1] * corner[1])
        handles[portion.name] = portion.name, point
    grips = []
    for key, (name, point) in handles.items():
        if pull := pull_on(instance, natural, projection.camera, name, point):
            grips.append(_Grip(key, projection.on_screen(point)[0], pull))
    return grips


def _ring(box: Bounds) -> list[tuple[float, float, float]]:
    """Return the corners of the box's cut along the plane."""
    assert box.plane is not None
    ends = (box.low[0], box.high[0]), (box.low[1], box.high[1])
    return [(ends[0][x], ends[1][y], box.plane) for x, y in ((0, 0), (0, 1), (1, 1), (1, 0))]


class _Projection(NamedTuple):
    """The camera of the view, and the place of its image on screen."""

    camera: Camera
    corner: ImVec2  # px on screen, of the image's upper left corner
    scale: float  # px on screen per px of the image

    @classmethod
    def of(cls, context: PanelContext, corner: ImVec2, size: ImVec2) -> "_Projection":
        request = context.session.viewport.request
        crop = request.crop(request.full)
        scale = size.y / crop.height
        return cls(crop.camera, corner - ImVec2(crop.left * scale, crop.top * scale), scale)

    def on_screen(self, *points: Sequence[float]) -> list[ImVec2]:
        """Return the places (px on screen) of points in the world."""
        pixels = self.camera.project(torch.tensor(points)).tolist()
        return [self.corner + ImVec2(x * self.scale, y * self.scale) for x, y in pixels]


def _draw_edges(context: PanelContext, projection: _Projection, box: Bounds) -> None:
    corners = projection.on_screen(*product(*zip(box.low, box.high, strict=True)))
    draw = imgui.get_window_draw_list()
    colour = packed(context.palette.accent, 0.8)
    for first, second in _EDGES:
        draw.add_line(corners[first], corners[second], colour, 1.5)
    if box.plane is not None:
        ring = projection.on_screen(*_ring(box))
        for number, corner in enumerate(ring):
            draw.add_line(ring[number - 1], corner, colour, 1.0)
