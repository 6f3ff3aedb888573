"""The tool that pulls the shape while G is held; a ring names the direction of change under the mouse."""

from collections.abc import Sequence

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, PLATE, PLATE_OPACITY, packed

_KEY = imgui.Key.g
_RING = 0.05  # radius of the ring as a fraction of the view's shorter side


class Grab:
    """The pull in progress."""

    def __init__(self) -> None:
        self._start: ImVec2 | None = None  # where the drag began, px on screen; None between drags

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw the ring over the view, imgui's last item; return whether the tool takes the mouse."""
        grabbing, mouse = context.session.grabbing, imgui.get_mouse_pos()
        words = (context.session.words or {}).get("shape", ())
        if self._start is not None:
            if imgui.is_item_active():
                grabbing.drag((mouse.x - self._start.x, mouse.y - self._start.y), words)
            else:
                self._start = None
                grabbing.release()
        held = imgui.is_key_down(_KEY) and not imgui.get_io().want_text_input
        if self._start is None and not (
            held and imgui.is_item_hovered() and context.session.viewport.source == "scene"
        ):
            return False
        if self._start is None:
            grabbing.look(((mouse.x - corner.x) / size.x, (mouse.y - corner.y) / size.y))
            if imgui.is_item_activated():
                self._start = mouse
        _draw_ring(context, mouse, _RING * min(size.x, size.y), words)
        return True


def _draw_ring(context: PanelContext, mouse: ImVec2, radius: float, words: Sequence[str]) -> None:
    """Draw the ring, a line along the surface's motion, and the direction's word."""
    pull, em, draw = context.session.grabbing.pull, hello_imgui.em_size(), imgui.get_window_draw_list()
    colour = packed(context.palette.accent if pull else context.palette.quiet)
    draw.add_circle(mouse, radius, colour, thickness=2.0)
    if pull is None:
        return
    along = ImVec2(*pull.motion)
    if length := (along.x**2 + along.y**2) ** 0.5:
        reach = along * (1.6 * radius / length)
        draw.add_line(mouse - reach, mouse + reach, colour, 2.0)
    word = words[pull.direction] if pull.direction < len(words) else ""
    if not word:
        return
    extent, low = imgui.calc_text_size(word), mouse + ImVec2(1.2 * radius, 0.8 * radius)
    pad = ImVec2(0.4 * em, 0.2 * em)
    draw.add_rect_filled(low - pad, low + extent + pad, packed(PLATE, PLATE_OPACITY), 0.3 * em)
    draw.add_text(low, packed(ON_PLATE), word)
