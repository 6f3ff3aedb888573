"""The way from A to B, for shape and texture separately."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer import faces
from viewer.desk import Desk, tip
from viewer.session import PARTS
from viewer.theme import WARM, Colour, mixed, packed

_PAD_HELP = "Drag: to the right the shape goes from A to B, upwards the texture does"


class MixPanel:
    """A pad and two sliders that do the same: a place between A and B."""

    title = "Mix"
    dock = "Top"

    def draw(self, desk: Desk) -> None:
        """A, the pad, the sliders, B."""
        if not desk.session.ready:
            imgui.text_disabled("The objects come with the model")
            return
        mix, em, gap = desk.session.state.mix, hello_imgui.em_size(), imgui.get_style().item_spacing.x
        side = 4.0 * em
        _draw_face(desk, mix.a, "A", desk.palette.accent, side)
        imgui.same_line()
        pad = max(side, min(imgui.get_content_region_avail().y, imgui.get_content_region_avail().x / 3))
        self._draw_pad(desk, pad)
        imgui.same_line()
        imgui.begin_group()
        self._draw_sliders(desk, imgui.get_content_region_avail().x - side - gap)
        imgui.end_group()
        imgui.same_line()
        _draw_face(desk, mix.b, "B", WARM, side)

    def _draw_pad(self, desk: Desk, side: float) -> None:
        session, corner = desk.session, imgui.get_cursor_screen_pos()
        imgui.invisible_button("mix pad", (side, side))
        if imgui.is_item_active():
            at = (imgui.get_mouse_pos() - corner) / side
            session.mix_both(_within(at.x), _within(1 - at.y), gesture="mix pad")
        if imgui.is_item_deactivated():
            session.settle()
        if not imgui.is_item_active():  # it would hide what the hand does
            tip(_PAD_HELP)
        _paint_pad(desk, corner, side)

    def _draw_sliders(self, desk: Desk, width: float) -> None:
        for part in PARTS:
            imgui.set_next_item_width(width)
            amount, label = getattr(desk.session.state.mix, part), f"{part.capitalize()}  %.2f"
            moved, to = imgui.slider_float(f"##mix {part}", amount, 0.0, 1.0, label)
            if moved:
                desk.session.mix(part, _within(to), gesture=f"mix {part}")
            if imgui.is_item_deactivated():
                desk.session.settle()
            tip(f"Slide the {part} from A to B; the other stays as it is")


def _paint_pad(desk: Desk, corner: ImVec2, side: float) -> None:
    draw, mix, palette, em = imgui.get_window_draw_list(), desk.session.state.mix, desk.palette, hello_imgui.em_size()
    opposite = corner + ImVec2(side, side)
    draw.add_rect_filled(corner, opposite, packed(palette.raised), faces.rounding())
    place = corner + ImVec2(mix.shape, 1 - mix.texture) * side
    line = packed(mixed(palette.raised, palette.text, 0.25))
    draw.add_line((place.x, corner.y), (place.x, opposite.y), line)
    draw.add_line((corner.x, place.y), (opposite.x, place.y), line)
    draw.add_text(ImVec2(corner.x + 0.3 * em, opposite.y - 1.2 * em), packed(palette.accent), "A")
    draw.add_text(ImVec2(opposite.x - 0.9 * em, corner.y + 0.1 * em), packed(WARM), "B")
    draw.add_circle_filled(place, 0.35 * em, packed(palette.accent))


def _draw_face(desk: Desk, name: str, letter: str, colour: Colour, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.dummy((side, side))
    tip(f"{letter} is {name}")
    faces.paint(desk, name, corner, side)
    faces.frame(corner, side, colour)
    faces.mark(corner, letter, colour)


def _within(amount: float) -> float:
    return min(1.0, max(0.0, amount))
