"""The handle of the part under the mouse: a drag reshapes the object, a click opens the part's colours."""

import time

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.editing.parts import Handle
from core.editing.size import lengths
from viewer.activities.reshaping import VisibleParts
from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, PLATE, PLATE_OPACITY, packed
from viewer.widgets.controls import tooltip
from viewer.widgets.paint import draw_colour_popup
from viewer.widgets.text import paint_on_plate

_REST = 0.12  # s without motion after which the part under the mouse lights up
_RADIUS, _GAP = 0.5, 0.35  # em: radius of the handle, and gap to the name above
_POPUP = "part colours"
_DROP = icons_fontawesome_4.ICON_FA_TINT
_RESHAPE, _COLOUR = "Drag: higher, wider or deeper", "Click: its colour"
_LOCKED = "The shape is locked in Sliders"


class PartHandle:
    """Lights up the part under the resting mouse, and draws its handle with its name."""

    def __init__(self) -> None:
        self._lit: tuple[VisibleParts, Handle] | None = None
        self._is_held = False
        self._hovered = False  # the mouse was over the handle in the last frame
        self._moved = 0.0  # s on the monotonic clock when the mouse moved last

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw glow, handle and name over the view, and let the handle be dragged or clicked.

        Call before the view's own item, so that the handle gets the mouse first, with the front channel chosen.
        """
        draw_colour_popup(context, _POPUP, swatches=True)
        self._hovered = False
        if self._lit is None:
            return
        visible, handle = self._lit
        x, y = visible.place_of(handle)
        middle = corner + ImVec2(x * size.x, y * size.y)
        if self._is_held:
            middle += imgui.get_mouse_drag_delta(0, 0.0)
        else:
            _draw_glow(context, visible, handle, corner, size)
        self._draw_handle(context, handle, middle, corner)

    def _draw_handle(self, context: PanelContext, handle: Handle, middle: ImVec2, corner: ImVec2) -> None:
        """Draw handle and name as one button, ``middle`` being the handle's middle."""
        em = hello_imgui.em_size()
        draw = imgui.get_window_draw_list()
        label = self._label(context, handle)
        extent = imgui.calc_text_size(label)
        pad = ImVec2(0.5 * em, 0.2 * em)
        low = middle - ImVec2(extent.x / 2 + pad.x, (_RADIUS + _GAP) * em + extent.y + 2 * pad.y)
        low = ImVec2(max(low.x, corner.x), max(low.y, corner.y))
        high = low + extent + pad * 2
        reach = ImVec2(1.3 * _RADIUS * em, 1.3 * _RADIUS * em)
        for name, start, end in (("handle", middle - reach, middle + reach), ("part name", low, high)):
            imgui.set_cursor_screen_pos(start)
            imgui.invisible_button(name, end - start)
            self._react(context, handle)
        colour = packed(context.palette.accent if self._hovered else ON_PLATE)
        draw.add_circle_filled(middle, _RADIUS * em, packed(PLATE, PLATE_OPACITY))
        draw.add_circle_filled(middle, 0.62 * _RADIUS * em, colour)
        paint_on_plate(low + pad, label, pad)

    def _label(self, context: PanelContext, handle: Handle) -> str:
        """Return the part's name and, during a drag, the length that changes."""
        reshaping = context.session.reshaping
        name = handle.part.capitalize()
        natural = context.session.sizing.bounds
        if reshaping.pull is None or natural is None:
            return f"{name}  {_DROP}" if _takes_paint(context, handle) else name
        length = lengths(context.session.editor.scene.instance, natural)[reshaping.pull.name]
        end = ", no further" if reshaping.is_past_end else ""
        return f"{name}: {reshaping.pull.name} {length:.3g} cm{end}"

    def _react(self, context: PanelContext, handle: Handle) -> None:
        """React to imgui's last item, a part of the handle."""
        reshaping = context.session.reshaping
        self._hovered |= imgui.is_item_hovered() or imgui.is_item_active()
        if imgui.is_item_hovered():
            imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
        is_locked = "shape" in context.session.editor.locked
        usage = [_LOCKED if is_locked else _RESHAPE]
        tooltip(
            "\n".join([*usage, _COLOUR] if _takes_paint(context, handle) else usage), above=False
        )  # the name is there
        self._is_held |= imgui.is_item_activated()
        if self._is_held and imgui.is_item_active() and not is_locked:
            drag = imgui.get_mouse_drag_delta(0, 0.0) / min(context.view[1] - context.view[0])
            reshaping.drag_handle(handle, (drag.x, drag.y))
        if imgui.is_item_deactivated():
            self._is_held = False
            if reshaping.pull:
                reshaping.release()
                self._lit = None
            elif _takes_paint(context, handle):
                context.session.painting.part = handle.part
                imgui.open_popup(_POPUP)

    def follow_mouse(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Choose the part to light up in the next frame; call after the view's own item, imgui's last one."""
        if self._is_held:
            if imgui.is_any_mouse_down():
                return
            self._is_held = False  # released while the view was not drawn, as after Ctrl+N
        io = imgui.get_io()
        lit = self._lit
        visible = None
        is_over = imgui.is_item_hovered() or self._hovered
        if context.tool == "turn" and is_over and not imgui.is_any_mouse_down():
            visible = context.session.reshaping.parts
        if visible is None or (lit and lit[0] is not visible):
            self._lit = None
        elif any(io.mouse_delta):
            self._moved = time.monotonic()
        elif time.monotonic() - self._moved > _REST and not self._hovered:
            mouse = io.mouse_pos - corner
            handle = visible.handle_at((mouse.x / size.x, mouse.y / size.y))
            self._lit = (visible, handle) if handle else None
        if self._lit != lit:
            hello_imgui.request_refresh()


def _takes_paint(context: PanelContext, handle: Handle) -> bool:
    painting = context.session.painting
    is_locked = "texture" in context.session.editor.locked
    return not is_locked and (handle.part in painting.parts or not painting.parts)


def _draw_glow(context: PanelContext, visible: VisibleParts, handle: Handle, corner: ImVec2, size: ImVec2) -> None:
    """Draw the glow over a part, below the view's buttons."""
    assert context.images
    draw = imgui.get_window_draw_list()
    texture = context.images.texture(visible.highlights[handle.part], context.palette)
    left, top, right, bottom = visible.box
    draw.channels_set_current(0)
    draw.add_image(texture, corner, corner + size, (left, top), (right, bottom))
    draw.channels_set_current(1)
