"""The objects as thumbnails."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import Desk, tip
from viewer.screen.theme import WARM, Colour, packed
from viewer.session import PARTS
from viewer.widgets import object_tiles as faces

_CELL = 4.6
"""em"""
_FITTED: Colour = (0.35, 0.75, 0.5)
"""the dot on objects that were fitted"""


class Objects:
    """Click one to show it (it is A), drag it to a slot, or right click it to choose."""

    title = "Objects"
    dock = "Upper"

    def draw(self, desk: Desk) -> None:
        """All objects; those out of sight are not asked for."""
        if not desk.session.ready:
            imgui.text_disabled("The objects come with the model")
            return
        if imgui.begin_child("grid"):
            self._draw_grid(desk)
        imgui.end_child()

    def _draw_grid(self, desk: Desk) -> None:
        names, em = desk.session.gallery.names, hello_imgui.em_size()
        gap = 0.4 * em
        room = imgui.get_content_region_avail().x
        columns = max(1, int((room + gap) / (_CELL * em + gap)))
        side = (room - gap * (columns - 1)) / columns
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        for first in range(0, len(names), columns):
            if not imgui.is_rect_visible((room, side)):  # hundreds of objects cost nothing while scrolled away
                imgui.dummy((room, side))
                continue
            for column, name in enumerate(names[first : first + columns]):
                if column:
                    imgui.same_line()
                _cell(desk, name, side)
        imgui.pop_style_var()


def _cell(desk: Desk, name: str, side: float) -> None:
    session, corner = desk.session, imgui.get_cursor_screen_pos()
    if imgui.invisible_button(f"show {name}", (side, side)):
        session.show(name)
    hovered = imgui.is_item_hovered()
    tip(f"{name}\nClick to show it, drag it to a slot, right click to choose")
    if imgui.begin_drag_drop_source():
        desk.dragged = name
        imgui.set_drag_drop_payload_py_id(faces.DRAGGED, 0)
        imgui.text(name)
        imgui.end_drag_drop_source()
    if imgui.begin_popup_context_item():
        _draw_menu(desk, name)
        imgui.end_popup()
    faces.paint(desk, name, corner, side)
    draw = imgui.get_window_draw_list()
    for number, (label, colour) in enumerate(_marks(desk, name)):
        faces.frame(corner, side, colour, inset=2.0 * number)
        faces.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), label, colour)
    if hovered:
        draw.add_rect_filled(corner, corner + ImVec2(side, side), packed((1, 1, 1), 0.12), faces.rounding())
    if session.gallery[name].photo:
        low = corner + ImVec2(side, side) - ImVec2(0.75, 0.75) * hello_imgui.em_size()
        draw.add_circle_filled(low, 0.3 * hello_imgui.em_size(), packed(_FITTED))


def _draw_menu(desk: Desk, name: str) -> None:
    session = desk.session
    if imgui.menu_item_simple("Show it"):
        session.show(name)
    for part in PARTS:
        if imgui.menu_item_simple(f"Take only its {part}", enabled=part not in session.locked):
            session.take(part, name)
    if imgui.menu_item_simple("Make it B"):
        session.pick_b(name)
    if imgui.menu_item_simple("Add to the sheet"):
        session.sheet.add(name)
        desk.focus = "Sheet"


def _marks(desk: Desk, name: str) -> list[tuple[str, Colour]]:
    """What an object is just now: A, what A's shape or texture was taken from, B."""
    mix, accent = desk.session.state.mix, desk.palette.accent
    if mix.a == (name, name):
        marks = [("A", accent)]
    else:
        marks = [(faces.ICONS[part], accent) for part in PARTS if getattr(mix.a, part) == name]
    return [*marks, ("B", WARM)] if mix.b == name else marks
