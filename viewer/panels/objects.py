"""The objects as thumbnails, and the way from A to B."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.desk import Desk, tip
from viewer.session import PARTS
from viewer.theme import WARM, Colour, packed

_CELL = 4.6
"""em"""
_FITTED: Colour = (0.35, 0.75, 0.5)
"""the dot on objects that were fitted"""


class Objects:
    """Click one to show it (it is A), right click one to make it B, then slide."""

    title = "Objects"
    dock = "Upper"

    def draw(self, desk: Desk) -> None:
        """The two sliders between A and B, and all objects below."""
        if not desk.session.ready:
            imgui.text_disabled("The objects come with the model")
            return
        self._draw_mix(desk)
        imgui.separator()
        if imgui.begin_child("grid"):
            self._draw_grid(desk)
        imgui.end_child()

    def _draw_mix(self, desk: Desk) -> None:
        mix, em = desk.session.state.mix, hello_imgui.em_size()
        side, gap = 4.0 * em, imgui.get_style().item_spacing.x
        _face(desk, mix.a, "A", desk.palette.accent, side)
        imgui.same_line()
        imgui.begin_group()
        width = imgui.get_content_region_avail().x - side - gap
        for part in PARTS:
            imgui.set_next_item_width(width)
            label = f"{part.capitalize()}  %.2f"
            moved, to = imgui.slider_float(f"##mix {part}", getattr(mix, part), 0.0, 1.0, label)
            if moved:
                desk.session.mix(part, min(1.0, max(0.0, to)), gesture=f"mix {part}")
            if imgui.is_item_deactivated():
                desk.session.settle()
            tip(f"Slide the {part} from A to B; the other stays as it is")
        imgui.text_disabled("Click: A    Right click: B")
        imgui.end_group()
        imgui.same_line()
        _face(desk, mix.b, "B", WARM, side)

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
    _paint(desk, name, corner, side)
    mix, draw = session.state.mix, imgui.get_window_draw_list()
    marks = [(mix.a, "A", desk.palette.accent), (mix.b, "B", WARM)]
    for number, (_, letter, colour) in enumerate(mark for mark in marks if mark[0] == name):
        _frame(corner, side, colour, inset=2.0 * number)
        _mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), letter, colour)
    if hovered:
        draw.add_rect_filled(corner, corner + ImVec2(side, side), packed((1, 1, 1), 0.12), _rounding())
    if session.gallery[name].photo:
        low = corner + ImVec2(side, side) - ImVec2(0.75, 0.75) * hello_imgui.em_size()
        draw.add_circle_filled(low, 0.3 * hello_imgui.em_size(), packed(_FITTED))


def _face(desk: Desk, name: str, letter: str, colour: Colour, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.dummy((side, side))
    tip(f"{letter} is {name}")
    _paint(desk, name, corner, side)
    _frame(corner, side, colour)
    _mark(corner, letter, colour)


def _paint(desk: Desk, name: str, corner: ImVec2, side: float) -> None:
    draw, opposite = imgui.get_window_draw_list(), corner + ImVec2(side, side)
    picture = desk.session.gallery.picture(name)
    if picture is None or desk.images is None:
        draw.add_rect_filled(corner, opposite, packed(desk.palette.raised), _rounding())
        return
    texture = desk.images.texture(picture, desk.palette)
    draw.add_image_rounded(texture, corner, opposite, (0, 0), (1, 1), 0xFFFFFFFF, _rounding())


def _frame(corner: ImVec2, side: float, colour: Colour, inset: float = 0.0) -> None:
    low, high = corner + ImVec2(inset, inset), corner + ImVec2(side - inset, side - inset)
    imgui.get_window_draw_list().add_rect(low, high, packed(colour), _rounding(), thickness=2.0)


def _mark(corner: ImVec2, letter: str, colour: Colour) -> None:
    draw, em = imgui.get_window_draw_list(), hello_imgui.em_size()
    draw.add_rect_filled(corner, corner + ImVec2(1.2, 1.2) * em, packed(colour), _rounding())
    place = corner + ImVec2(0.6, 0.6) * em - imgui.calc_text_size(letter) * 0.5
    draw.add_text(place, packed((0.06, 0.07, 0.08)), letter)


def _rounding() -> float:
    return 0.3 * hello_imgui.em_size()
