"""Every state that undo remembers, as thumbnails in a row; a click brings one back."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.rendering.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import Panel, PanelContext
from viewer.screen.theme import packed
from viewer.values.history import State
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip


class HistoryPanel(Panel):
    """The oldest on the left; what undo took back is on the right of what is shown, paler."""

    title = "History"
    dock = "Strip"

    def __init__(self) -> None:
        self._shown = -1
        """the state that was last scrolled to"""

    def draw(self, context: PanelContext) -> None:
        """The row, which scrolls to what is shown."""
        history = context.editor.history
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail()
        side = max(2 * em, min(object_tiles.THUMBNAIL * em, room.y - imgui.get_style().scrollbar_size))
        if imgui.begin_child("row", (0, 0), 0, imgui.WindowFlags_.horizontal_scrollbar):
            imgui.push_style_var(imgui.StyleVar_.item_spacing, (0.3 * em, 0.3 * em))
            for index, state in enumerate(history.states):
                if index:
                    imgui.same_line()
                self._draw_state(context, index, state, side)
            imgui.pop_style_var()
        imgui.end_child()

    def _draw_state(self, context: PanelContext, index: int, state: State, side: float) -> None:
        history = context.editor.history
        now, corner = len(history.past), imgui.get_cursor_screen_pos()
        if not imgui.is_rect_visible((side, side)):  # hundreds of states cost nothing while scrolled away
            imgui.dummy((side, side))
        elif imgui.invisible_button(f"state {index + 1}", (side, side)):
            context.editor.go_to(index)
        if index == now and self._shown != now:
            imgui.set_scroll_here_x()
            self._shown = now
        tooltip(_label(index - now))
        object_tiles.paint_frame(
            context, _thumbnail(context, state, index == now and bool(history.gesture)), corner, side
        )
        if index > now:
            pale = packed(context.palette.panel, 0.55)
            imgui.get_window_draw_list().add_rect_filled(
                corner, corner + ImVec2(side, side), pale, object_tiles.rounding()
            )
        if index == now:
            object_tiles.outline(corner, side, context.palette.accent)


def _thumbnail(context: PanelContext, state: State, moving: bool) -> Frame | None:
    """A state's thumbnail; none during a drag, as the state is another in the next frame."""
    scene, now = state.scene, state is context.editor.state
    camera = scene.camera.resized(SIZE, SIZE)
    return None if moving else context.thumbnails.get(scene.codes, camera, soon=now)


def _label(steps: int) -> str:
    if steps == 0:
        return "What is shown"
    count = f"{abs(steps)} step{'s' if abs(steps) > 1 else ''}"
    return f"Click to go {count} {'back' if steps < 0 else 'forward'}"
