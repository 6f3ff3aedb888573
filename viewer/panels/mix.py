"""Whose shape and whose texture A is, and the way from A to B."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.models.codes import Codes
from viewer.context import Panel, PanelContext
from viewer.screen.theme import ON_PLATE, WARM, Colour, packed
from viewer.values.part import PARTS, Part
from viewer.values.variety import readable
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, end_gesture, labelled_slider, tooltip, tooltip_beside
from viewer.widgets.text import caption, heading, paint_caption, small_height

_OPEN, _LOCKED = icons_fontawesome_4.ICON_FA_UNLOCK_ALT, icons_fontawesome_4.ICON_FA_LOCK
_LEAST, _MOST, _BELOW = 9.0, 22.0, 7.0  # em: the side of the pad, and what stands below it
_PREVIEWS = 5  # along each side of the pad; each is the mix that the dot over its middle means
_PREVIEW, _SAMPLES, _FAINT = 48, 32, 0.55  # px, intervals, and opacity of previews in no corner


class MixPanel(Panel):
    """Two slots to take a shape and a texture from, and a pad and two sliders that mix them with B's."""

    title = "Mix"
    dock = "Right"

    def __init__(self) -> None:
        self._ends: tuple[Codes, Codes] | None = None
        self._previews: dict[tuple[int, int], Codes] = {}  # by column and row, from A's corner

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
        room, em = imgui.get_content_region_avail(), hello_imgui.em_size()
        self._draw_pad(context, min(room.x, max(_LEAST * em, min(_MOST * em, room.y - _BELOW * em))))
        caption(context, "Drag the dot: to the right B's shape, upwards B's texture")
        self._draw_sliders(context)
        if button("Swap###swap", "The shape from where the texture was taken, and the other way round"):
            context.session.editor.swap()

    def _draw_slot(self, context: PanelContext, part: Part, side: float) -> None:
        editor = context.session.editor
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
        label, colour = f"{_LOCKED if locked else _OPEN}  Lock###lock {part}", context.palette.accent
        if button(label, what, side / hello_imgui.em_size(), colour=colour if locked else None):
            editor.lock(part, not locked)
        imgui.end_group()

    def _draw_b(self, context: PanelContext, side: float) -> None:
        b = context.session.editor.state.mix.b
        imgui.begin_group()
        _draw_face(context, b, "B", WARM, side)
        tooltip(f"B is {readable(b)}\nDrop an object here to make it B")
        if dropped := object_tiles.dropped(context):
            context.session.editor.set_b(dropped)
        _draw_caption(context, "B", side)
        imgui.end_group()

    def _draw_pad(self, context: PanelContext, side: float) -> None:
        """The dot stays half a preview within the border, so that it can be grabbed in a corner."""
        editor, corner, cell = context.session.editor, imgui.get_cursor_screen_pos(), side / _PREVIEWS
        imgui.invisible_button("mix pad", (side, side))
        under = imgui.get_mouse_pos() - corner
        if imgui.is_item_active():
            across, up = (_within((at - cell / 2) / (side - cell)) for at in (under.x, side - under.y))
            editor.mix_both(across, up, gesture="mix pad")
        end_gesture(context)
        over = (int(under.x / cell), int((side - under.y) / cell)) if imgui.is_item_hovered() else None
        self._paint_previews(context, corner, side, over)
        _paint_dot(context, corner, side)

    def _paint_previews(self, context: PanelContext, corner: ImVec2, side: float, over: tuple[int, int] | None) -> None:
        """What the mixes look like; that under the mouse (column and row) stands out."""
        self._follow(context)
        cell, last = side / _PREVIEWS, _PREVIEWS - 1
        size, ground = ImVec2(cell, cell), packed(context.palette.panel, 1 - _FAINT)
        imgui.get_window_draw_list().add_rect_filled(
            corner, corner + size * _PREVIEWS, packed(context.palette.raised), object_tiles.rounding()
        )
        for (column, row), codes in self._previews.items():
            place = corner + ImVec2(column, last - row) * cell
            preview = context.session.thumbnails.of_object(codes, _PREVIEW, _SAMPLES)
            object_tiles.paint_frame(context, preview, place, cell)
            if (column, row) == over:
                object_tiles.outline(place, cell, context.palette.accent)
            elif not {column, row} <= {0, last}:
                imgui.get_window_draw_list().add_rect_filled(place, place + size, ground)
        object_tiles.mark(corner + ImVec2(0, last) * cell, "A", context.palette.accent)
        object_tiles.mark(corner + ImVec2(last, 0) * cell, "B", WARM)

    def _follow(self, context: PanelContext) -> None:
        """The previews, from the corners inwards, wherever A or B is another."""
        mix, editor = context.session.editor.state.mix, context.session.editor
        ends = editor.pair(mix.a), editor.objects[mix.b].codes
        if ends != self._ends:
            steps = sorted(range(_PREVIEWS), key=lambda step: -abs(step - _PREVIEWS // 2))
            self._previews = {
                (column, row): ends[0].mixed(ends[1], column / (_PREVIEWS - 1), row / (_PREVIEWS - 1))
                for row in steps
                for column in steps
            }
            self._ends = ends

    def _draw_sliders(self, context: PanelContext) -> None:
        for part in PARTS:
            imgui.begin_disabled(part in context.session.editor.locked)
            amount = getattr(context.session.editor.state.mix, part)
            label = part.capitalize()
            moved, to = labelled_slider(f"mix {part}", label, amount, (0.0, 1.0), f"{amount:.0%}")
            imgui.end_disabled()
            if moved:
                context.session.editor.mix(part, _within(to), gesture=f"mix {part}")
            end_gesture(context)
            tooltip_beside(f"Slide the {part} from A to B; the other stays as it is", "Ctrl+click to type 0 to 1")


def _draw_caption(context: PanelContext, words: str, width: float) -> None:
    paint_caption(context, words, imgui.get_cursor_screen_pos(), width)
    imgui.dummy((width, small_height()))


def _paint_dot(context: PanelContext, corner: ImVec2, side: float) -> None:
    draw, mix, palette, em = (
        imgui.get_window_draw_list(),
        context.session.editor.state.mix,
        context.palette,
        hello_imgui.em_size(),
    )
    inset = side / _PREVIEWS / 2
    place = corner + ImVec2(inset, inset) + ImVec2(mix.shape, 1 - mix.texture) * (side - 2 * inset)
    line = packed(palette.accent, 0.5)
    draw.add_line((place.x, corner.y), (place.x, corner.y + side), line)
    draw.add_line((corner.x, place.y), (corner.x + side, place.y), line)
    draw.add_circle_filled(place, 0.55 * em, packed(ON_PLATE))
    draw.add_circle_filled(place, 0.42 * em, packed(palette.accent))


def _draw_face(context: PanelContext, name: str, label: str, colour: Colour, side: float, slot: str = "slot B") -> None:
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(slot, (side, side))
    object_tiles.paint(context, name, corner, side)
    object_tiles.outline(corner, side, colour)
    object_tiles.mark(corner, label, colour)


def _within(amount: float) -> float:
    return min(1.0, max(0.0, amount))
