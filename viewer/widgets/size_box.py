"""A box around the object in the view, with handles for its sides and for legs or roof."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from imgui_bundle import ImVec2, hello_imgui, imgui

from core.editing.bounds import Bounds, Portion, portion_of
from core.editing.size import with_portion, with_side
from core.geometry.camera import Camera
from core.models.model import Instance
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


class _Handle(NamedTuple):
    """A place in the view that is dragged to change a length."""

    key: str  # of the widget
    name: str  # of the length
    length: float  # cm
    middle: ImVec2  # px on screen
    motion: ImVec2  # px on screen per scene unit
    resized: Callable[[float], Instance]  # the object after a drag, scene units along the motion


class SizeBox:
    """The box, drawn while the tool is *size* or the size's rows are under the mouse."""

    def __init__(self) -> None:
        self._held: tuple[_Handle, ImVec2] | None = None  # dragged handle and mouse when the drag began

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw the box over the view, and its handles if it is the current tool."""
        is_hinted = context.shows_size
        context.shows_size = False
        natural = context.session.sizing.bounds
        if context.session.viewport.source != "scene" or natural is None:
            return
        is_tool = context.tool == "size"
        projection = _Projection.of(context, corner, size)
        instance = context.session.editor.scene.instance
        codes = instance.codes
        box = natural.after(codes.edits_of("size")).in_units(codes.scale)
        if is_tool or is_hinted:
            _draw_edges(context, projection, box)
        is_free = "shape" not in context.session.editor.locked
        for handle in _handles(instance, natural, projection, box) if is_tool and is_free else ():
            self._draw_handle(context, handle)

    def _draw_handle(self, context: PanelContext, handle: _Handle) -> None:
        radius = hello_imgui.em_size(_RADIUS)
        mouse = imgui.get_mouse_pos()
        imgui.set_cursor_screen_pos(handle.middle - ImVec2(1.5 * radius, 1.5 * radius))
        imgui.invisible_button(f"##size {handle.key}", (3 * radius, 3 * radius))
        if imgui.is_item_activated():
            self._held = handle, mouse
        if imgui.is_item_active() and self._held and any(imgui.get_io().mouse_delta):
            held, start = self._held
            drag = mouse - start
            along = drag.x * held.motion.x + drag.y * held.motion.y
            moved = along / (held.motion.x**2 + held.motion.y**2)
            context.session.editor.edit(held.resized(moved), gesture="size box")
        end_gesture(context)
        active = imgui.is_item_hovered() or imgui.is_item_active()
        draw = imgui.get_window_draw_list()
        draw.add_circle_filled(handle.middle, radius * (1.3 if active else 1.0), packed(context.palette.accent))
        draw.add_circle(handle.middle, radius * (1.3 if active else 1.0), packed(ON_PLATE), thickness=1.5)
        words = f"{handle.name} {handle.length:.3g} cm" if active else f"{handle.length:.3g} cm"
        low = handle.middle + ImVec2(2 * radius, -imgui.get_text_line_height() / 2)
        paint_on_plate(low, words, ImVec2(0.3, 0.1) * hello_imgui.em_size())


def _handles(instance: Instance, natural: Bounds, projection: "_Projection", box: Bounds) -> list[_Handle]:
    """Return the handles of the sides that face the camera, and of the plane."""
    factors = instance.codes.factors
    handles = []
    for side in projection.sides(box):
        axis = side.axis
        reach = max(abs(side.place), _NEAR_MIDDLE * (box.high[axis] - box.low[axis]))

        def resized(moved: float, axis: int = axis, reach: float = reach) -> Instance:
            return with_side(instance, axis, factors[axis] * max(0.01, 1 + moved / reach))

        key = f"{axis} {side.outwards}"
        handles.append(_Handle(key, SIDES[axis], box.size[axis], side.middle, side.motion, resized))
    portion = portion_of(instance.model)
    if portion and box.plane is not None:
        handles += _plane_handle(instance, natural, projection, box, portion)
    return handles


def _plane_handle(
    instance: Instance, natural: Bounds, projection: "_Projection", box: Bounds, portion: Portion
) -> list[_Handle]:
    """Return the handle on the plane's line, at its right; none as seen from above."""
    across, along, _ = projection.camera.pose()[:3, 0].tolist()
    x, y, z = max(_ring(box), key=lambda corner: across * corner[0] + along * corner[1])
    place, above = projection.on_screen((x, y, z), (x, y, z + _STEP))
    motion = (above - place) / _STEP
    if not projection.shows(motion):
        return []
    length = box.length(portion)
    # The object grows around the scene's middle, so its lower end sinks by this much of the growth.
    sinking = -box.low[2] / (box.high[2] - box.low[2])
    rate = max(_NEAR_MIDDLE, 1 - sinking) if portion.is_below else -max(_NEAR_MIDDLE, sinking)
    growth = box.cm / (rate * box.length(portion))  # relative, per scene unit that the plane moves

    def resized(moved: float) -> Instance:
        return with_portion(instance, natural, max(0.01, 1 + growth * moved) * length)

    return [_Handle(portion.name, portion.name.capitalize(), length, place, motion, resized)]


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
        places = self.camera.project(torch.tensor(points)).tolist()
        return [self.corner + ImVec2(x * self.scale, y * self.scale) for x, y in places]

    def shows(self, motion: ImVec2) -> bool:
        """Return whether a motion in px per scene unit is across the line of sight, not along it."""
        across = self.scale * self.camera.focal / self.camera.distance  # px per scene unit
        return bool((motion.x**2 + motion.y**2) ** 0.5 > _SHORT * across)

    def sides(self, bounds: Bounds) -> list[_Side]:
        """Return the top of a box and the sides that face the camera, unless seen end on."""
        eye = self.camera.pose()[:3, 3].tolist()
        middle = [(low + high) / 2 for low, high in zip(bounds.low, bounds.high, strict=True)]
        sides = []
        for axis in range(3):
            for outwards, end in ((-1, bounds.low), (1, bounds.high)):
                face = [*middle[:axis], end[axis], *middle[axis + 1 :]]
                beside = [*face[:axis], face[axis] + outwards * _STEP, *face[axis + 1 :]]
                place, moved = self.on_screen(face, beside)
                motion = (moved - place) / _STEP
                is_top = (axis, outwards) == (2, 1)
                if self.shows(motion) and (is_top or outwards * (eye[axis] - face[axis]) > 0):
                    sides.append(_Side(axis, outwards, face[axis], place, motion))
        return sides


def _draw_edges(context: PanelContext, projection: _Projection, box: Bounds) -> None:
    points = [tuple((box.low, box.high)[number][axis] for axis, number in enumerate(corner)) for corner in _CORNERS]
    places = projection.on_screen(*points)
    draw = imgui.get_window_draw_list()
    colour = packed(context.palette.accent, 0.8)
    for first, second in _EDGES:
        draw.add_line(places[first], places[second], colour, 1.5)
    if box.plane is not None:
        ring = projection.on_screen(*_ring(box))
        for number, place in enumerate(ring):
            draw.add_line(ring[number - 1], place, colour, 1.0)
