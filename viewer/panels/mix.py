"""Whose shape and whose texture A is, and the way from A to B."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import Desk, button, tip
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.session import PARTS, Part
from viewer.widgets import object_tiles as faces

_OPEN, _LOCKED = icons_fontawesome_4.ICON_FA_UNLOCK_ALT, icons_fontawesome_4.ICON_FA_LOCK
_PAD_HELP = "Drag: to the right the shape goes from A to B, upwards the texture does"


class MixPanel:
    """Two slots to take a shape and a texture from, and a pad and two sliders that mix them with B's."""

    title = "Mix"
    dock = "Top"

    def draw(self, desk: Desk) -> None:
        """The slots, the pad, the sliders, B."""
        if not desk.session.ready:
            imgui.text_disabled("The objects come with the model")
            return
        gap, side = imgui.get_style().item_spacing.x, 3.4 * hello_imgui.em_size()
        for part in PARTS:
            self._draw_slot(desk, part, side)
            imgui.same_line()
        room = imgui.get_content_region_avail()
        self._draw_pad(desk, max(side, min(room.y, room.x / 3)))
        imgui.same_line()
        imgui.begin_group()
        width = imgui.get_content_region_avail().x - side - gap
        self._draw_sliders(desk, width)
        self._draw_swap(desk, width)
        imgui.end_group()
        imgui.same_line()
        b = desk.session.state.mix.b
        _draw_face(desk, b, "B", WARM, side)
        tip(f"B is {b}\nDrop an object here to make it B")
        if dropped := faces.dropped(desk):
            desk.session.pick_b(dropped)

    def _draw_slot(self, desk: Desk, part: Part, side: float) -> None:
        session = desk.session
        name, locked = getattr(session.state.mix.a, part), part in session.locked
        imgui.begin_group()
        _draw_face(desk, name, faces.ICONS[part], desk.palette.accent, side, f"slot {part}")
        invited = (
            "It is locked: the lock below lets it change" if locked else f"Drop an object here to take only its {part}"
        )
        tip(f"The {part} is taken from {name}\n{invited}")
        if not locked and (dropped := faces.dropped(desk)):
            session.take(part, dropped)
        what = f"Let the {part} change again" if locked else f"Keep the {part}, whatever is picked or drawn at random"
        if button(f"{_LOCKED if locked else _OPEN}###lock {part}", what, width=3.4):
            session.lock(part, not locked)
        imgui.end_group()

    def _draw_swap(self, desk: Desk, width: float) -> None:
        if imgui.button("Swap###swap", (width, 0)):
            desk.session.swap()
        tip("The shape from where the texture was taken, and the other way round")

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
            imgui.begin_disabled(part in desk.session.locked)
            imgui.set_next_item_width(width)
            amount = getattr(desk.session.state.mix, part)
            wide = width > imgui.calc_text_size("Texture  0.00").x
            label = f"{part.capitalize() if wide else faces.ICONS[part]}  %.2f"
            moved, to = imgui.slider_float(f"##mix {part}", amount, 0.0, 1.0, label)
            imgui.end_disabled()
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


def _draw_face(desk: Desk, name: str, label: str, colour: Colour, side: float, slot: str = "slot B") -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(slot, (side, side))
    faces.paint(desk, name, corner, side)
    faces.frame(corner, side, colour)
    faces.mark(corner, label, colour)


def _within(amount: float) -> float:
    return min(1.0, max(0.0, amount))
