"""The panel that mixes object A, in the view, with object B."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.models.model import Instance
from viewer.context import Panel, PanelContext
from viewer.screen.theme import ON_PLATE, WARM, packed
from viewer.values.mixes import STEPS, mixes
from viewer.widgets import object_tiles
from viewer.widgets.controls import end_gesture, tooltip
from viewer.widgets.text import caption, heading

_LEAST, _MOST, _BELOW = 9.0, 30.0, 4.0  # em: least and largest side of the pad, and height below it
_PREVIEW, _SAMPLES = 48, 32  # px and intervals of previews


class MixPanel(Panel):
    """B's tile, and a pad that mixes shape and texture of A and B."""

    title = "Mix"
    dock = "Right"

    def __init__(self) -> None:
        self._ends: tuple[Instance, Instance] | None = None  # A and B of the previews
        self._previews: dict[tuple[int, int], Instance] = {}  # mixes by column and row, counted from A's corner

    def draw(self, context: PanelContext) -> None:
        """Draw B above the pad."""
        _draw_b(context)
        room = imgui.get_content_region_avail()
        em = hello_imgui.em_size()
        self._draw_pad(context, min(room.x, max(_LEAST * em, min(_MOST * em, room.y - _BELOW * em))))
        caption(context, "Drag the dot: to the right B's shape, upwards B's texture")

    def _draw_pad(self, context: PanelContext, side: float) -> None:
        """Draw the pad. The dot stays half a preview inside, so that it can be grabbed in a corner."""
        editor = context.session.editor
        corner = imgui.get_cursor_screen_pos()
        cell = side / STEPS
        if imgui.get_io().nav_visible and not imgui.is_mouse_hovering_rect(corner, corner + ImVec2(side, side)):
            over = self._draw_cells(context, corner, cell)
        else:
            imgui.invisible_button("mix pad", (side, side))
            under = imgui.get_mouse_pos() - corner
            if imgui.is_item_active():
                right, up = (min(1.0, max(0.0, (px - cell / 2) / (side - cell))) for px in (under.x, side - under.y))
                editor.mix_both(right, up, gesture="mix pad")
            end_gesture(context)
            over = (int(under.x / cell), int((side - under.y) / cell)) if imgui.is_item_hovered() else None
        self._paint_previews(context, corner, side, over)
        _paint_dot(context, corner, side)

    def _draw_cells(self, context: PanelContext, corner: ImVec2, cell: float) -> tuple[int, int] | None:
        """Draw an invisible button per mix for the keyboard; return column and row of the focused one."""
        focused = None
        for row in reversed(range(STEPS)):
            for column in range(STEPS):
                imgui.set_cursor_screen_pos(corner + ImVec2(column, STEPS - 1 - row) * cell)
                if object_tiles.tile_button(f"mix {column} {row}", (cell, cell)):
                    context.session.editor.mix_both(column / (STEPS - 1), row / (STEPS - 1))
                if imgui.is_item_focused():
                    focused = column, row
        return focused

    def _paint_previews(self, context: PanelContext, corner: ImVec2, side: float, over: tuple[int, int] | None) -> None:
        """Draw the previews of the mixes; the one at ``over`` (column and row) is outlined."""
        editor = context.session.editor
        ends = editor.mix_ends
        if ends != self._ends and not editor.history.gesture:
            self._ends = ends
            self._previews = mixes(*ends)
        cell = side / STEPS
        last = STEPS - 1
        object_tiles.shade(corner, side, context.palette.raised)
        for (column, row), instance in self._previews.items():
            low = corner + ImVec2(column, last - row) * cell
            preview = context.session.thumbnails.of_object(instance, _PREVIEW, _SAMPLES)
            object_tiles.paint_frame(context, preview, low, cell)
            if (column, row) == over:
                object_tiles.outline(low, cell, context.palette.accent)
        object_tiles.mark(corner + ImVec2(0, last) * cell, "A", context.palette.accent)
        object_tiles.mark(corner + ImVec2(last, 0) * cell, "B", WARM)


def _draw_b(context: PanelContext) -> None:
    name = context.session.editor.state.mix.b
    em = hello_imgui.em_size()
    corner = imgui.get_cursor_screen_pos()
    room = imgui.get_content_region_avail().x
    side = min(object_tiles.THUMBNAIL * em, 0.4 * room)
    imgui.invisible_button("slot B", (side, side))
    label = context.session.names.label(name)
    tooltip(f"B is {label}\nDrop another object here, or right click one in the library and make it B")
    if dropped := object_tiles.dropped(context):
        context.session.editor.set_b(dropped)
    object_tiles.paint(context, context.session.editor.objects[name].instance, corner, side)
    object_tiles.outline(corner, side, WARM)
    object_tiles.mark(corner, "B", WARM)
    imgui.same_line()
    imgui.begin_group()
    heading(context, label)
    caption(context, "Drop another object on it")
    imgui.end_group()


def _paint_dot(context: PanelContext, corner: ImVec2, side: float) -> None:
    draw = imgui.get_window_draw_list()
    mix = context.session.editor.state.mix
    accent = context.palette.accent
    inset = side / STEPS / 2
    em = hello_imgui.em_size()
    dot = corner + ImVec2(inset, inset) + ImVec2(mix.shape, 1 - mix.texture) * (side - 2 * inset)
    line = packed(accent, 0.5)
    draw.add_line((dot.x, corner.y), (dot.x, corner.y + side), line)
    draw.add_line((corner.x, dot.y), (corner.x + side, dot.y), line)
    draw.add_circle_filled(dot, 0.55 * em, packed(ON_PLATE))
    draw.add_circle_filled(dot, 0.42 * em, packed(accent))
