"""The shape x texture grid: rows are shapes, columns are textures."""

from imgui_bundle import ImVec2, icons_fontawesome_4, imgui

from core.models.scene import IMAGE_FORMATS
from core.rendering.progressive import Frame
from viewer.activities.grid import MAX_OBJECTS
from viewer.context import Panel, PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.screen.theme import mixed, packed
from viewer.values.history import Pair
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, draw_progress, tooltip

_SIZE, _SAMPLES = 96, 64  # px of a pair's thumbnail, and intervals along the box
_ADD = icons_fontawesome_4.ICON_FA_PLUS
_INVITATION = "Every shape in every texture. Or drop objects on the square; a click on it adds A and B."
_FILL = 3  # objects that fill an empty grid


class GridPanel(Panel):
    """Chosen objects along both borders, and every pair of them; a click makes a pair current."""

    title = "Grid"
    dock = "Right"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """The buttons, and the grid as large as the panel allows."""
        grid = context.session.grid
        if grid.names:
            self._draw_buttons(context)
        count, gap = len(grid.names) + 1, 0.2 * imgui.get_font_size()
        room = imgui.get_content_region_avail()
        side = max(2.0 * imgui.get_font_size(), min(room.x, room.y) / max(count, 4) - gap)
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        self._draw_corner(context, side)
        for name in grid.names:
            imgui.same_line()
            _draw_head(context, name, "texture", side)
        for number, row in enumerate(grid.rows):
            _draw_head(context, row[0].shape, "shape", side)
            for column, pair in enumerate(row):
                imgui.same_line()
                _draw_cell(context, f"pair {number + 1} {column + 1}", pair, side)
        imgui.pop_style_var()
        if not grid.names:
            what = "Three objects of the library, of the forms that differ most"
            if button(f"Fill with {_FILL} x {_FILL}###fill", what, colour=context.palette.accent):
                editor = context.session.editor
                grid.add(*[*editor.objects.families[editor.model.fingerprint]][:_FILL])
            imgui.text_wrapped(_INVITATION)

    def _draw_buttons(self, context: PanelContext) -> None:
        exporting, grid = context.session.exporting, context.session.grid
        if draw_progress(context, "grid"):
            return
        if button("Export grid…###export grid", "All pairs as one image", enabled=not exporting.running):
            context.files.ask(FileRequest("Export the grid as", exporting.grid, IMAGE_FORMATS, True, "grid.png"))
        imgui.same_line()
        if button("Clear###clear grid", "An empty grid"):
            grid.clear()

    def _draw_corner(self, context: PanelContext, side: float) -> None:
        mix = context.session.editor.state.mix
        enabled = len(context.session.grid.names) < MAX_OBJECTS
        imgui.begin_disabled(not enabled)
        if imgui.button(f"{_ADD}  Add###add", (side, side)):
            context.session.grid.add(*mix.a, mix.b)
        imgui.end_disabled()
        tooltip("Click to add A and B, or drop an object here" if enabled else f"{MAX_OBJECTS} objects are the most")
        if dropped := object_tiles.dropped(context, mixed=False):
            context.session.grid.add(dropped)


def _draw_head(context: PanelContext, name: str, part: str, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    if imgui.invisible_button(f"{part} of {name}", (side, side)):
        context.session.grid.remove(name)
    tooltip(f"The {part} of {name}\nClick to take it out of the grid")
    object_tiles.paint(context, name, corner, side)
    edge = corner + (ImVec2(0, side - 2) if part == "texture" else ImVec2(side - 2, 0))
    line = packed(mixed(context.palette.panel, context.palette.text, 0.5))
    imgui.get_window_draw_list().add_rect_filled(edge, corner + ImVec2(side, side), line)


def _draw_cell(context: PanelContext, label: str, pair: Pair, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    if imgui.invisible_button(label, (side, side)):
        context.session.editor.show_pair(pair)
    tooltip(f"The shape of {pair.shape}\nin the texture of {pair.texture}")
    object_tiles.paint_frame(context, _thumbnail(context, pair), corner, side)
    if context.session.editor.state.mix.a == pair:
        object_tiles.outline(corner, side, context.palette.accent)


def _thumbnail(context: PanelContext, pair: Pair) -> Frame | None:
    return context.session.thumbnails.of_object(context.session.editor.pair(pair), _SIZE, _SAMPLES)
