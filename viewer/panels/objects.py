"""The objects as thumbnails."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer import faces
from viewer.desk import Desk, tip
from viewer.theme import WARM, Colour, packed

_CELL = 4.6
"""em"""
_FITTED: Colour = (0.35, 0.75, 0.5)
"""the dot on objects that were fitted"""


class Objects:
    """Click one to show it (it is A), right click one to make it B."""

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
    if imgui.is_item_clicked(imgui.MouseButton_.right):
        session.pick_b(name)
    tip(f"{name}\nClick to show it (A), right click to make it B")
    faces.paint(desk, name, corner, side)
    mix, draw = session.state.mix, imgui.get_window_draw_list()
    marks = [(mix.a, "A", desk.palette.accent), (mix.b, "B", WARM)]
    for number, (_, letter, colour) in enumerate(mark for mark in marks if mark[0] == name):
        faces.frame(corner, side, colour, inset=2.0 * number)
        faces.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), letter, colour)
    if hovered:
        draw.add_rect_filled(corner, corner + ImVec2(side, side), packed((1, 1, 1), 0.12), faces.rounding())
    if session.gallery[name].photo:
        low = corner + ImVec2(side, side) - ImVec2(0.75, 0.75) * hello_imgui.em_size()
        draw.add_circle_filled(low, 0.3 * hello_imgui.em_size(), packed(_FITTED))
