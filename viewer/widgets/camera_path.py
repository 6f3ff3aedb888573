"""The way of the camera through the timeline, drawn over the view on a map of where the object can be seen from."""

from itertools import pairwise

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.export.keyframes import Timeline
from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, PLATE, PLATE_OPACITY, WARM, packed
from viewer.values.orbit_map import HORIZON, moved_to, place
from viewer.widgets.controls import end_gesture, tooltip

_RADIUS = 4.5  # em
_DOT = 0.4  # em, radius of a keyframe
_SAMPLES = 96  # points of the way
_MAP_HELP = "From where the object is seen: the middle is above it, the circle the horizon, the bottom its front"


class CameraPath:
    """A dot for every keyframe, to be dragged, and one for the camera of the view."""

    def __init__(self) -> None:
        self._way: tuple[Timeline, list[tuple[float, float]]] | None = None  # of which timeline, and its places

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """In the lower right corner of the view, if that is large enough."""
        timeline, em = context.session.player.timeline, hello_imgui.em_size()
        if not context.preferences.camera_path or len(timeline.keys) < 2 or min(size.x, size.y) < 4 * _RADIUS * em:
            return
        middle, radius = corner + size - ImVec2(1, 1) * (_RADIUS + 0.7) * em, _RADIUS * em
        imgui.set_cursor_screen_pos(middle - ImVec2(radius, radius))
        imgui.set_next_item_allow_overlap()
        imgui.invisible_button("camera path", (2 * radius, 2 * radius))
        tooltip(_MAP_HELP)
        self._paint(context, timeline, middle, radius)
        for index in range(len(timeline.keys)):
            _draw_key(context, index, middle, radius)

    def _paint(self, context: PanelContext, timeline: Timeline, middle: ImVec2, radius: float) -> None:
        draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
        draw.add_circle_filled(middle, radius, packed(PLATE, PLATE_OPACITY))
        draw.add_circle(middle, HORIZON * radius, packed(ON_PLATE, 0.35))
        draw.add_line(middle + ImVec2(0, radius - 0.4 * em), middle + ImVec2(0, radius), packed(ON_PLATE, 0.6))
        if self._way is None or self._way[0] is not timeline:
            times = (timeline.length * number / (_SAMPLES - 1) for number in range(_SAMPLES))
            self._way = timeline, [place(timeline.at(seconds).camera) for seconds in times]
        way = [middle + ImVec2(*there) * radius for there in self._way[1]]
        for one, other in pairwise(way):
            draw.add_line(one, other, packed(context.palette.accent), 0.12 * em)
        here = middle + ImVec2(*place(context.session.editor.scene.camera)) * radius
        draw.add_circle(here, 0.55 * em, packed(WARM), thickness=0.12 * em)


def _draw_key(context: PanelContext, index: int, middle: ImVec2, radius: float) -> None:
    player, em = context.session.player, hello_imgui.em_size()
    key = player.timeline.keys[index]
    there = middle + ImVec2(*place(key.view.camera)) * radius
    imgui.set_cursor_screen_pos(there - ImVec2(_DOT, _DOT) * em)
    imgui.set_next_item_allow_overlap()
    moved = imgui.get_mouse_drag_delta(imgui.MouseButton_.left)  # until the release, and in that frame still
    if imgui.invisible_button(f"path key {index + 1}", ImVec2(2 * _DOT, 2 * _DOT) * em) and not any(moved):
        player.go_to_key(index)
    if imgui.is_item_active() and imgui.is_mouse_dragging(imgui.MouseButton_.left):
        at = (imgui.get_mouse_pos() - middle) / radius
        player.aim_key(index, moved_to(key.view.camera, at.x, at.y))
    end_gesture(context)
    tooltip(f"Key {index + 1} at {key.seconds:.2f} s\nClick to show it, drag it to see the object from elsewhere")
    filled = context.palette.accent if player.key == index else ON_PLATE
    imgui.get_window_draw_list().add_circle_filled(there, _DOT * em, packed(filled))
