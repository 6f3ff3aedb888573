"""A box around the object in the view, with a handle on each side that faces the camera."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from imgui_bundle import ImVec2, hello_imgui, imgui

from core.geometry.camera import Camera, Factors
from core.rendering.size import Bounds, with_side
from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, packed
from viewer.widgets.controls import end_gesture
from viewer.widgets.size_row import SIDES
from viewer.widgets.text import paint_on_plate

_CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
_EDGES = [(a, b) for a in range(8) for b in range(a) if sum(map(abs, map(int.__sub__, _CORNERS[a], _CORNERS[b]))) == 1]
_STEP = 0.01  # scene units over which a side's motion in the view is measured
_SHORT = 0.15  # motion of a side, relative to one across the line of sight, below which it has no handle
_RADIUS = 0.42  # em, of a handle
_NEAR_MIDDLE = 0.25  # least distance of a side from the middle of the stretch, relative to the object's length


class _Side(NamedTuple):
    """A side of the box as the view shows it."""

    axis: int
    outwards: int  # -1 or 1
    place: float  # scene units along the axis, from the middle of the stretch
    middle: ImVec2  # px on screen
    motion: ImVec2  # px on screen per scene unit outwards


class SizeBox:
    """The box, drawn while the tool is *size* or the size's row is under the mouse."""

    def __init__(self) -> None:
        self._held: tuple[_Side, ImVec2, Factors] | None = None  # dragged side, mouse and stretch when the drag began

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw the box over the view, and its handles if it is the current tool."""
        is_hinted = context.shows_size
        context.shows_size = False
        bounds = context.session.sizing.bounds
        if context.session.viewport.source != "scene" or bounds is None:
            return
        is_tool = context.tool == "size"
        projection = _Projection.of(context, corner, size)
        if is_tool or is_hinted:
            _draw_edges(context, projection, bounds)
        is_free = "shape" not in context.session.editor.locked
        for side in projection.sides(_stretched(context, bounds)) if is_tool and is_free else ():
            self._draw_handle(context, side, bounds)

    def _draw_handle(self, context: PanelContext, side: _Side, bounds: Bounds) -> None:
        editor = context.session.editor
        radius = hello_imgui.em_size(_RADIUS)
        mouse = imgui.get_mouse_pos()
        imgui.set_cursor_screen_pos(side.middle - ImVec2(1.5 * radius, 1.5 * radius))
        imgui.invisible_button(f"##size {side.axis} {side.outwards}", (3 * radius, 3 * radius))
        stretch = editor.scene.instance.codes.factors
        if imgui.is_item_activated():
            self._held = side, mouse, stretch
        if imgui.is_item_active() and self._held and any(imgui.get_io().mouse_delta):
            held, start, before = self._held
            factor = before[held.axis] * _growth(held, bounds, mouse - start, context)
            editor.resize(with_side(before, held.axis, factor), gesture="size box")
        end_gesture(context)
        active = imgui.is_item_hovered() or imgui.is_item_active()
        draw = imgui.get_window_draw_list()
        draw.add_circle_filled(side.middle, radius * (1.3 if active else 1.0), packed(context.palette.accent))
        draw.add_circle(side.middle, radius * (1.3 if active else 1.0), packed(ON_PLATE), thickness=1.5)
        natural = bounds.size(editor.model.metres)
        length = natural[side.axis] * editor.scene.instance.codes.factors[side.axis]
        words = f"{SIDES[side.axis]} {length:.3g} cm" if active else f"{length:.3g} cm"
        low = side.middle + ImVec2(2 * radius, -imgui.get_text_line_height() / 2)
        paint_on_plate(low, words, ImVec2(0.3, 0.1) * hello_imgui.em_size())


def _growth(side: _Side, bounds: Bounds, drag: ImVec2, context: PanelContext) -> float:
    """Return the factor of a side's length after a drag (px), which the side follows."""
    square = side.motion.x**2 + side.motion.y**2
    outwards = (drag.x * side.motion.x + drag.y * side.motion.y) / square
    low, high = _stretched(context, bounds)
    length = high[side.axis] - low[side.axis]
    return max(0.01, 1 + outwards / max(abs(side.place), _NEAR_MIDDLE * length))


def _stretched(context: PanelContext, bounds: Bounds) -> Bounds:
    factors = context.session.editor.scene.instance.codes.proportions or (1.0, 1.0, 1.0)
    return bounds.stretched(factors)


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
        places = self.camera.project(torch.tensor(points)).tolist()
        return [self.corner + ImVec2(x * self.scale, y * self.scale) for x, y in places]

    def sides(self, bounds: Bounds) -> list[_Side]:
        """Return the sides of a box that face the camera and move across its line of sight."""
        eye = self.camera.pose()[:3, 3].tolist()
        middle = [(low + high) / 2 for low, high in zip(*bounds, strict=True)]
        across = self.scale * self.camera.focal / self.camera.distance  # px per scene unit
        sides = []
        for axis in range(3):
            for outwards, end in ((-1, bounds.low), (1, bounds.high)):
                face = [*middle[:axis], end[axis], *middle[axis + 1 :]]
                beside = [*face[:axis], face[axis] + outwards * _STEP, *face[axis + 1 :]]
                place, moved = self.on_screen(face, beside)
                motion = (moved - place) / _STEP
                long = (motion.x**2 + motion.y**2) ** 0.5 > _SHORT * across
                if long and outwards * (eye[axis] - face[axis]) > 0:
                    sides.append(_Side(axis, outwards, face[axis], place, motion))
        return sides


def _draw_edges(context: PanelContext, projection: _Projection, bounds: Bounds) -> None:
    ends = _stretched(context, bounds)
    points = [tuple(ends[number][axis] for axis, number in enumerate(corner)) for corner in _CORNERS]
    places = projection.on_screen(*points)
    draw = imgui.get_window_draw_list()
    colour = packed(context.palette.accent, 0.8)
    for first, second in _EDGES:
        draw.add_line(places[first], places[second], colour, 1.5)
