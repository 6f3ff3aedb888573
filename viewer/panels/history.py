"""The undo history as thumbnails along the view's lower edge. Not a docked panel."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.rendering.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import PanelContext
from viewer.values.history import Edit, History, State
from viewer.widgets import missing_tiles, object_tiles
from viewer.widgets.controls import OVERLAY_FLAGS, tooltip

_SIDE, _EDGE = 2.7, 0.5  # em: side of a thumbnail, and distance from the view's corner


class HistoryStrip:
    """A strip with a tile per object, the oldest first, and per edit of the object on screen.

    Undone edits are paler.
    """

    def __init__(self) -> None:
        self._shown = -1  # index of the state that was last scrolled to
        self._history: History | None = None  # history of the values below, kept while it is the same
        self._states: tuple[State, ...] = ()
        self._groups: tuple[tuple[Edit, ...], ...] = ()

    def draw(self, context: PanelContext) -> None:
        """Draw the strip, scrolled to the current edit, once there are two edits."""
        history = context.session.editor.history
        if history is not self._history:
            self._history, self._states, self._groups = history, history.states, history.edits
        em, (low, high) = hello_imgui.em_size(), context.view
        context.covered = 0.0
        if sum(map(len, self._groups)) < 2:
            return
        tiles = self._tiles(len(history.past))
        side, gap = _SIDE * em, 0.3 * em
        width = min(high.x - low.x - 2 * _EDGE * em, len(tiles) * (side + gap) + 2 * gap)
        height = side + 3 * gap
        context.covered = height + _EDGE * em
        imgui.set_next_window_pos(ImVec2(low.x + _EDGE * em, high.y - _EDGE * em - height))
        imgui.set_next_window_size((width, height))
        imgui.set_next_window_bg_alpha(0.85)
        imgui.push_style_var(imgui.StyleVar_.window_padding, (1.5 * gap, 1.5 * gap))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        hidden = imgui.WindowFlags_
        flags = OVERLAY_FLAGS & ~(hidden.always_auto_resize | hidden.no_nav) | hidden.horizontal_scrollbar
        if imgui.begin("History", None, flags)[0]:
            for number, (edit, first) in enumerate(tiles):
                if number:
                    imgui.same_line()
                self._draw_edit(context, number, range(first, edit.last + 1), edit, side)
            if imgui.is_window_hovered() and (wheel := imgui.get_io().mouse_wheel):
                imgui.set_scroll_x(imgui.get_scroll_x() - wheel * side)
        imgui.end()
        imgui.pop_style_var(2)

    def _tiles(self, now: int) -> list[tuple[Edit, int]]:
        """Return the shown edits, each with the index of its tile's first state."""
        tiles, first = list[tuple[Edit, int]](), 0
        for group in self._groups:
            unfolded = first <= now <= group[-1].last
            for edit in group if unfolded else group[-1:]:
                tiles.append((edit, first))
                first = edit.last + 1
        return tiles

    def _draw_edit(self, context: PanelContext, number: int, states: range, edit: Edit, side: float) -> None:
        """Draw an edit's tile; a click goes to the last of its states."""
        if not context.session.editor.can_show(self._states[edit.last]):
            missing_tiles.draw_state(context, self._states[edit.last], edit, f"state {number + 1}", side)
            return
        history = context.session.editor.history
        now, corner, shown = len(history.past), imgui.get_cursor_screen_pos(), len(history.past) in states
        if not imgui.is_rect_visible((side, side)):  # hundreds of states cost nothing while scrolled away
            imgui.dummy((side, side))
        elif object_tiles.tile_button(f"state {number + 1}", (side, side)) and not shown:
            context.session.editor.go_to(edit.last)
        if shown and self._shown != now:
            imgui.set_scroll_here_x()
            self._shown = now
        way = "forward" if states[0] > now else "back"
        tooltip(edit.words[:1].upper() + edit.words[1:] if shown else f"Click to go {way} to: {edit.words}")
        state = history.now if shown else self._states[edit.last]
        object_tiles.paint_frame(context, _thumbnail(context, state, shown and bool(history.gesture)), corner, side)
        if states[0] > now:
            object_tiles.shade(corner, side, context.palette.panel, object_tiles.DIMMED)
        if shown:
            object_tiles.outline(corner, side, context.palette.accent)


def _thumbnail(context: PanelContext, state: State, moving: bool) -> Frame | None:
    """Return a state's thumbnail from its camera; None during a drag, which changes the state in every frame."""
    scene, now = state.scene, state is context.session.editor.state
    camera = scene.camera.resized(SIZE, SIZE)
    return None if moving else context.session.thumbnails.get(scene.codes, camera, soon=now)
