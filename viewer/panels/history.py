"""Every state that undo remembers, as small pictures in a row; a click brings one back."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.rendering.progressive import Frame
from viewer.context import Desk, tip
from viewer.screen.theme import packed
from viewer.values.history import State
from viewer.widgets import object_tiles as faces

_STILL = 64
"""px"""


class Visited:
    """The oldest on the left; what undo took back is on the right of what is shown, paler."""

    title = "Visited"
    dock = "Strip"

    def __init__(self) -> None:
        self._shown = -1
        """the state that was last scrolled to"""

    def draw(self, desk: Desk) -> None:
        """The row, which scrolls to what is shown."""
        history = desk.session.history
        if history is None:
            imgui.text_disabled("What you visit comes here")
            return
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail()
        side = max(2 * em, min(6 * em, room.y - 1.2 * em))
        if imgui.begin_child("row", (0, 0), 0, imgui.WindowFlags_.horizontal_scrollbar):
            imgui.push_style_var(imgui.StyleVar_.item_spacing, (0.3 * em, 0.3 * em))
            for index, state in enumerate(history.states):
                if index:
                    imgui.same_line()
                self._draw_state(desk, index, state, side)
            imgui.pop_style_var()
        imgui.end_child()

    def _draw_state(self, desk: Desk, index: int, state: State, side: float) -> None:
        history = desk.session.history
        assert history is not None
        now, corner = len(history.past), imgui.get_cursor_screen_pos()
        if not imgui.is_rect_visible((side, side)):  # hundreds of states cost nothing while scrolled away
            imgui.dummy((side, side))
        elif imgui.invisible_button(f"state {index + 1}", (side, side)):
            desk.session.return_to(index)
        if index == now and self._shown != now:
            imgui.set_scroll_here_x()
            self._shown = now
        tip(_told(index - now))
        faces.paint_frame(desk, _picture(desk, state, index == now and bool(history.gesture)), corner, side)
        if index > now:
            pale = packed(desk.palette.panel, 0.55)
            imgui.get_window_draw_list().add_rect_filled(corner, corner + ImVec2(side, side), pale, faces.rounding())
        if index == now:
            faces.frame(corner, side, desk.palette.accent)


def _picture(desk: Desk, state: State, moving: bool) -> Frame | None:
    """A state's picture; none of one that a hand is changing, as it is another in the next frame."""
    scene, now = state.scene, state is desk.session.state
    camera = scene.camera.resized(_STILL, _STILL)
    return None if moving else desk.session.stills.picture(scene.codes, camera, soon=now)


def _told(steps: int) -> str:
    if steps == 0:
        return "What is shown"
    count = f"{abs(steps)} step{'s' if abs(steps) > 1 else ''}"
    return f"Click to go {count} {'back' if steps < 0 else 'forward'}"
