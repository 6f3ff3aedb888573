"""Whose shape and whose texture A is, and the way from A to B."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import Panel, PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.part import PARTS, Part
from viewer.values.variety import readable
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, end_gesture, flow, labelled_slider, tooltip
from viewer.widgets.text import caption, heading, paint_caption, small_height

_OPEN, _LOCKED = icons_fontawesome_4.ICON_FA_UNLOCK_ALT, icons_fontawesome_4.ICON_FA_LOCK
_PAD = 10.0
"""em: 160 px at the usual size of text"""
_PAD_WORDS = "Across: shape. Up: texture."
_PAD_HELP = "Drag: to the right the shape goes from A to B, upwards the texture does"


class MixPanel(Panel):
    """Two slots to take a shape and a texture from, and a pad and two sliders that mix them with B's."""

    title = "Mix"
    dock = "Right"

    def draw(self, context: PanelContext) -> None:
        """The slots, the pad, the sliders."""
        gaps = 2 * imgui.get_style().item_spacing.x
        side = min(object_tiles.THUMBNAIL * hello_imgui.em_size(), (imgui.get_content_region_avail().x - gaps) / 3)
        for part in PARTS:
            self._draw_slot(context, part, side)
            imgui.same_line()
        self._draw_b(context, side)
        imgui.spacing()
        heading(context, "From A to B")
        self._draw_pad(context, min(_PAD * hello_imgui.em_size(), imgui.get_content_region_avail().x))
        flow(_PAD_WORDS)
        imgui.begin_group()
        caption(context, _PAD_WORDS)
        if button("Swap###swap", "The shape from where the texture was taken, and the other way round"):
            context.editor.swap()
        imgui.end_group()
        self._draw_sliders(context)

    def _draw_slot(self, context: PanelContext, part: Part, side: float) -> None:
        editor = context.editor
        name, locked = getattr(editor.state.mix.a, part), part in editor.locked
        imgui.begin_group()
        _draw_face(context, name, object_tiles.ICONS[part], context.palette.accent, side, f"slot {part}")
        invited = (
            "It is locked: the lock below lets it change" if locked else f"Drop an object here to take only its {part}"
        )
        tooltip(f"The {part} is taken from {readable(name)}\n{invited}")
        if not locked and (dropped := object_tiles.dropped(context)):
            editor.take(part, dropped)
        _draw_caption(context, f"A's {part}", side)
        what = f"Let the {part} change again" if locked else f"Keep the {part}, whatever is picked or sampled"
        if button(f"{_LOCKED if locked else _OPEN}###lock {part}", what, side / hello_imgui.em_size()):
            editor.lock(part, not locked)
        imgui.end_group()

    def _draw_b(self, context: PanelContext, side: float) -> None:
        b = context.editor.state.mix.b
        imgui.begin_group()
        _draw_face(context, b, "B", WARM, side)
        tooltip(f"B is {readable(b)}\nDrop an object here to make it B")
        if dropped := object_tiles.dropped(context):
            context.editor.set_b(dropped)
        _draw_caption(context, "B", side)
        imgui.end_group()

    def _draw_pad(self, context: PanelContext, side: float) -> None:
        editor, corner = context.editor, imgui.get_cursor_screen_pos()
        imgui.invisible_button("mix pad", (side, side))
        if imgui.is_item_active():
            at = (imgui.get_mouse_pos() - corner) / side
            editor.mix_both(_within(at.x), _within(1 - at.y), gesture="mix pad")
        end_gesture(context)
        if not imgui.is_item_active():  # it would cover the pad
            tooltip(_PAD_HELP)
        _paint_pad(context, corner, side)

    def _draw_sliders(self, context: PanelContext) -> None:
        for part in PARTS:
            imgui.begin_disabled(part in context.editor.locked)
            amount = getattr(context.editor.state.mix, part)
            label = part.capitalize()
            moved, to = labelled_slider(f"mix {part}", label, amount, (0.0, 1.0), f"{amount:.0%}")
            imgui.end_disabled()
            if moved:
                context.editor.mix(part, _within(to), gesture=f"mix {part}")
            end_gesture(context)
            tooltip(f"Slide the {part} from A to B; the other stays as it is. Ctrl+click to type 0 to 1")


def _draw_caption(context: PanelContext, words: str, width: float) -> None:
    paint_caption(context, words, imgui.get_cursor_screen_pos(), width)
    imgui.dummy((width, small_height()))


def _paint_pad(context: PanelContext, corner: ImVec2, side: float) -> None:
    draw, mix, palette, em = (
        imgui.get_window_draw_list(),
        context.editor.state.mix,
        context.palette,
        hello_imgui.em_size(),
    )
    opposite = corner + ImVec2(side, side)
    draw.add_rect_filled(corner, opposite, packed(palette.raised), object_tiles.rounding())
    draw.add_rect(corner, opposite, packed(palette.line), object_tiles.rounding())
    place = corner + ImVec2(mix.shape, 1 - mix.texture) * side
    line = packed(mixed(palette.raised, palette.text, 0.25))
    draw.add_line((place.x, corner.y), (place.x, opposite.y), line)
    draw.add_line((corner.x, place.y), (opposite.x, place.y), line)
    draw.add_text(ImVec2(corner.x + 0.3 * em, opposite.y - 1.2 * em), packed(palette.accent), "A")
    draw.add_text(ImVec2(opposite.x - 0.9 * em, corner.y + 0.1 * em), packed(palette.warm), "B")
    draw.add_circle_filled(place, 0.35 * em, packed(palette.accent))


def _draw_face(context: PanelContext, name: str, label: str, colour: Colour, side: float, slot: str = "slot B") -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(slot, (side, side))
    object_tiles.paint(context, name, corner, side)
    object_tiles.outline(corner, side, colour)
    object_tiles.mark(corner, label, colour)


def _within(amount: float) -> float:
    return min(1.0, max(0.0, amount))
