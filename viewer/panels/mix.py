"""Whose shape and whose texture A is, and the way from A to B."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.history import PARTS, Part
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, tooltip

_OPEN, _LOCKED = icons_fontawesome_4.ICON_FA_UNLOCK_ALT, icons_fontawesome_4.ICON_FA_LOCK
_PAD_HELP = "Drag: to the right the shape goes from A to B, upwards the texture does"


class MixPanel:
    """Two slots to take a shape and a texture from, and a pad and two sliders that mix them with B's."""

    title = "Mix"
    dock = "Top"
    waiting = "The objects come with the model"

    def draw(self, context: PanelContext) -> None:
        """The slots, the pad, the sliders, B."""
        gap, side = imgui.get_style().item_spacing.x, 3.4 * hello_imgui.em_size()
        for part in PARTS:
            self._draw_slot(context, part, side)
            imgui.same_line()
        room = imgui.get_content_region_avail()
        self._draw_pad(context, max(side, min(room.y, room.x / 3)))
        imgui.same_line()
        imgui.begin_group()
        width = imgui.get_content_region_avail().x - side - gap
        self._draw_sliders(context, width)
        self._draw_swap(context, width)
        imgui.end_group()
        imgui.same_line()
        b = context.editor.state.mix.b
        _draw_face(context, b, "B", WARM, side)
        tooltip(f"B is {b}\nDrop an object here to make it B")
        if dropped := object_tiles.dropped(context):
            context.editor.set_b(dropped)

    def _draw_slot(self, context: PanelContext, part: Part, side: float) -> None:
        editor = context.editor
        name, locked = getattr(editor.state.mix.a, part), part in editor.locked
        imgui.begin_group()
        _draw_face(context, name, object_tiles.ICONS[part], context.palette.accent, side, f"slot {part}")
        invited = (
            "It is locked: the lock below lets it change" if locked else f"Drop an object here to take only its {part}"
        )
        tooltip(f"The {part} is taken from {name}\n{invited}")
        if not locked and (dropped := object_tiles.dropped(context)):
            editor.take(part, dropped)
        what = f"Let the {part} change again" if locked else f"Keep the {part}, whatever is picked or sampled"
        if button(f"{_LOCKED if locked else _OPEN}###lock {part}", what, width=3.4):
            editor.lock(part, not locked)
        imgui.end_group()

    def _draw_swap(self, context: PanelContext, width: float) -> None:
        if imgui.button("Swap###swap", (width, 0)):
            context.editor.swap()
        tooltip("The shape from where the texture was taken, and the other way round")

    def _draw_pad(self, context: PanelContext, side: float) -> None:
        editor, corner = context.editor, imgui.get_cursor_screen_pos()
        imgui.invisible_button("mix pad", (side, side))
        if imgui.is_item_active():
            at = (imgui.get_mouse_pos() - corner) / side
            editor.mix_both(_within(at.x), _within(1 - at.y), gesture="mix pad")
        if imgui.is_item_deactivated():
            editor.end_gesture()
        if not imgui.is_item_active():  # it would cover the pad
            tooltip(_PAD_HELP)
        _paint_pad(context, corner, side)

    def _draw_sliders(self, context: PanelContext, width: float) -> None:
        for part in PARTS:
            imgui.begin_disabled(part in context.editor.locked)
            imgui.set_next_item_width(width)
            amount = getattr(context.editor.state.mix, part)
            wide = width > imgui.calc_text_size("Texture  0.00").x
            label = f"{part.capitalize() if wide else object_tiles.ICONS[part]}  %.2f"
            moved, to = imgui.slider_float(f"##mix {part}", amount, 0.0, 1.0, label)
            imgui.end_disabled()
            if moved:
                context.editor.mix(part, _within(to), gesture=f"mix {part}")
            if imgui.is_item_deactivated():
                context.editor.end_gesture()
            tooltip(f"Slide the {part} from A to B; the other stays as it is")


def _paint_pad(context: PanelContext, corner: ImVec2, side: float) -> None:
    draw, mix, palette, em = (
        imgui.get_window_draw_list(),
        context.editor.state.mix,
        context.palette,
        hello_imgui.em_size(),
    )
    opposite = corner + ImVec2(side, side)
    draw.add_rect_filled(corner, opposite, packed(palette.raised), object_tiles.rounding())
    place = corner + ImVec2(mix.shape, 1 - mix.texture) * side
    line = packed(mixed(palette.raised, palette.text, 0.25))
    draw.add_line((place.x, corner.y), (place.x, opposite.y), line)
    draw.add_line((corner.x, place.y), (opposite.x, place.y), line)
    draw.add_text(ImVec2(corner.x + 0.3 * em, opposite.y - 1.2 * em), packed(palette.accent), "A")
    draw.add_text(ImVec2(opposite.x - 0.9 * em, corner.y + 0.1 * em), packed(WARM), "B")
    draw.add_circle_filled(place, 0.35 * em, packed(palette.accent))


def _draw_face(context: PanelContext, name: str, label: str, colour: Colour, side: float, slot: str = "slot B") -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(slot, (side, side))
    object_tiles.paint(context, name, corner, side)
    object_tiles.outline(corner, side, colour)
    object_tiles.mark(corner, label, colour)


def _within(amount: float) -> float:
    return min(1.0, max(0.0, amount))
