"""The part that was clicked: its glow, its name, which opens its colours, and a handle that reshapes the object."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.editing.parts import Handle
from core.editing.size import lengths
from viewer.activities.reshaping import VisibleParts
from viewer.context import PanelContext
from viewer.screen.theme import ON_PLATE, PLATE, PLATE_OPACITY, packed
from viewer.values.view_request import ViewRequest
from viewer.widgets.controls import tooltip
from viewer.widgets.paint import draw_colour_popup
from viewer.widgets.text import paint_on_plate

_RADIUS, _GAP = 0.5, 0.35  # em: radius of the handle, and gap to the name above
_POPUP = "part colours"
_DROP = icons_fontawesome_4.ICON_FA_TINT
_RESHAPE = "Drag: higher, wider or deeper"


class PartHandle:
    """Lights up a clicked part until the image changes. A click on its name opens its colours."""

    def __init__(self) -> None:
        self._click: tuple[ViewRequest, ImVec2] | None = None  # image and px on screen, until the parts are found
        self._lit: tuple[VisibleParts, Handle] | None = None
        self._name_box = ImVec2(0, 0), ImVec2(0, 0)  # opposite corners, px on screen
        self._is_held = False

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw glow, handle and name over the view, and let the handle be dragged.

        Call before the view's own item, so that the handle gets the mouse first, with the front channel chosen.
        """
        draw_colour_popup(context, _POPUP, swatches=True)
        self._update(context, corner, size)
        if self._lit is None:
            return
        visible, handle = self._lit
        x, y = visible.place_of(handle)
        middle = corner + ImVec2(x * size.x, y * size.y)
        if self._is_held:
            middle += imgui.get_mouse_drag_delta(0, 0.0)
        else:
            _draw_glow(context, visible, handle, corner, size)
        if handle.is_outer:
            self._draw_handle(context, handle, middle)
        self._draw_name(context, handle, middle, corner)

    def click(self, context: PanelContext) -> None:
        """Light up the part under the mouse; on the name of the lit part open its colours."""
        mouse = imgui.get_mouse_pos()
        low, high = self._name_box
        if self._lit and low.x <= mouse.x < high.x and low.y <= mouse.y < high.y:
            if _takes_paint(context, self._lit[1]):
                imgui.open_popup(_POPUP)
            self._lit = None
        else:
            self._click = context.session.viewport.request, mouse

    def _update(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Choose the clicked part once the parts of the image are found; forget it when the image changes."""
        session = context.session
        if self._is_held and imgui.is_any_mouse_down():
            return
        self._is_held = False
        if self._click and self._click[0] != session.viewport.request:
            self._click = None
        visible = session.reshaping.parts if context.tool == "turn" and (self._click or self._lit) else None
        if self._lit and self._lit[0] is not visible:
            self._lit = None
        if self._click and visible:
            position = self._click[1] - corner
            handle = visible.handle_at((position.x / size.x, position.y / size.y))
            self._lit = (visible, handle) if handle else None
            self._click = None
            if handle and _takes_paint(context, handle):
                session.painting.part = handle.part

    def _draw_handle(self, context: PanelContext, handle: Handle, middle: ImVec2) -> None:
        """Draw the handle and react to its drag."""
        reshaping = context.session.reshaping
        em = hello_imgui.em_size()
        reach = ImVec2(1.3, 1.3) * _RADIUS * em
        imgui.set_cursor_screen_pos(middle - reach)
        imgui.invisible_button("handle", reach * 2)
        tooltip(_RESHAPE, above=False)  # the name is there
        self._is_held |= imgui.is_item_activated()
        if self._is_held and imgui.is_item_active():
            drag = imgui.get_mouse_drag_delta(0, 0.0) / min(context.view[1] - context.view[0])
            reshaping.drag_handle(handle, (drag.x, drag.y))
        if imgui.is_item_deactivated():
            self._is_held = False
            reshaping.release()
        is_hovered = imgui.is_item_hovered() or imgui.is_item_active()
        draw = imgui.get_window_draw_list()
        draw.add_circle_filled(middle, _RADIUS * em, packed(PLATE, PLATE_OPACITY))
        colour = packed(context.palette.accent if is_hovered else ON_PLATE)
        draw.add_circle_filled(middle, 0.62 * _RADIUS * em, colour)

    def _draw_name(self, context: PanelContext, handle: Handle, middle: ImVec2, corner: ImVec2) -> None:
        """Draw the name above the handle. It is no item of imgui, so that a drag over it turns the object."""
        em = hello_imgui.em_size()
        label = _label(context, handle)
        extent = imgui.calc_text_size(label)
        pad = ImVec2(0.5 * em, 0.2 * em)
        low = middle - ImVec2(extent.x / 2 + pad.x, (_RADIUS + _GAP) * em + extent.y + 2 * pad.y)
        low = ImVec2(max(low.x, corner.x), max(low.y, corner.y))
        self._name_box = low, low + extent + pad * 2
        if imgui.is_mouse_hovering_rect(*self._name_box):
            imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
        paint_on_plate(low + pad, label, pad)


def _label(context: PanelContext, handle: Handle) -> str:
    """Return the part's name and, during a drag, the length that changes."""
    reshaping = context.session.reshaping
    name = handle.part.capitalize()
    natural = context.session.reshaping.bounds
    if reshaping.pull is None or natural is None:
        return f"{name}  {_DROP}" if _takes_paint(context, handle) else name
    length = lengths(context.session.editor.scene.instance, natural)[reshaping.pull.name]
    end = ", no further" if reshaping.is_past_end else ""
    return f"{name}: {reshaping.pull.name} {length:.3g} cm{end}"


def _takes_paint(context: PanelContext, handle: Handle) -> bool:
    parts = context.session.painting.parts
    return handle.part in parts or not parts


def _draw_glow(context: PanelContext, visible: VisibleParts, handle: Handle, corner: ImVec2, size: ImVec2) -> None:
    """Draw the glow over a part, below the view's buttons."""
    draw = imgui.get_window_draw_list()
    texture = context.texture(visible.highlights[handle.part])
    left, top, right, bottom = visible.crop.box
    draw.channels_set_current(0)
    draw.add_image(texture, corner, corner + size, (left, top), (right, bottom))
    draw.channels_set_current(1)
