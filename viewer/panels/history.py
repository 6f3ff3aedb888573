"""Every edit that undo remembers, as thumbnails in a row; a click brings one back."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.rendering.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import Panel, PanelContext
from viewer.screen.theme import packed
from viewer.values.history import History, State
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip
from viewer.widgets.text import caption

_WORD = 4.0  # em, of the panel's name at the left


class HistoryPanel(Panel):
    """The oldest on the left; what undo took back is on the right of what is shown, paler."""

    title = "History"
    dock = "Strip"
    bare = True

    def __init__(self) -> None:
        self._shown = -1  # the state that was last scrolled to
        self._history: History | None = None
        self._states: tuple[State, ...] = ()
        self._edits: tuple[tuple[int, str], ...] = ()  # of that history

    def draw(self, context: PanelContext) -> None:
        """The row, which scrolls to what is shown."""
        history = context.session.editor.history
        if history is not self._history:
            self._history, self._states, self._edits = history, history.states, history.edits
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail()
        caption(context, "History")
        imgui.same_line(_WORD * em)
        side = max(em, min(object_tiles.THUMBNAIL * em, room.y))
        flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.horizontal_scrollbar
        if imgui.begin_child("row", (0, 0), 0, flags):
            imgui.push_style_var(imgui.StyleVar_.item_spacing, (0.3 * em, 0.3 * em))
            first = 0
            for number, (last, words) in enumerate(self._edits):
                if number:
                    imgui.same_line()
                self._draw_edit(context, number, range(first, last + 1), words, side)
                first = last + 1
            imgui.pop_style_var()
            if imgui.is_window_hovered() and (wheel := imgui.get_io().mouse_wheel):
                imgui.set_scroll_x(imgui.get_scroll_x() - wheel * side)
        imgui.end_child()

    def _draw_edit(self, context: PanelContext, number: int, states: range, words: str, side: float) -> None:
        """One tile for an edit and the moves of the camera after it; a click goes to the last of them."""
        history = context.session.editor.history
        now, corner, shown = len(history.past), imgui.get_cursor_screen_pos(), len(history.past) in states
        if not imgui.is_rect_visible((side, side)):  # hundreds of states cost nothing while scrolled away
            imgui.dummy((side, side))
        elif imgui.invisible_button(f"state {number + 1}", (side, side)) and not shown:
            context.session.editor.go_to(states[-1])
        if shown and self._shown != now:
            imgui.set_scroll_here_x()
            self._shown = now
        tooltip(words[:1].upper() + words[1:] if shown else f"Click to go back to: {words}")
        state = history.now if shown else self._states[states[-1]]
        object_tiles.paint_frame(context, _thumbnail(context, state, shown and bool(history.gesture)), corner, side)
        if states[0] > now:
            pale = packed(context.palette.panel, 0.55)
            imgui.get_window_draw_list().add_rect_filled(
                corner, corner + ImVec2(side, side), pale, object_tiles.rounding()
            )
        if shown:
            object_tiles.outline(corner, side, context.palette.accent)


def _thumbnail(context: PanelContext, state: State, moving: bool) -> Frame | None:
    """A state's thumbnail; none during a drag, as the state is another in the next frame."""
    scene, now = state.scene, state is context.session.editor.state
    camera = scene.camera.resized(SIZE, SIZE)
    return None if moving else context.session.thumbnails.get(scene.codes, camera, soon=now)
