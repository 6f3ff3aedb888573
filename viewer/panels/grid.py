"""The cross sheet: rows are shapes, columns are textures."""

from imgui_bundle import ImVec2, icons_fontawesome_4, imgui

from core.models.pictures import FORMATS
from viewer.activities.grid import MOST
from viewer.context import Desk, button, draw_progress, tip
from viewer.screen.file_dialog import Wish
from viewer.screen.theme import mixed, packed
from viewer.values.history import Pair
from viewer.widgets import object_tiles as faces

_ADD = icons_fontawesome_4.ICON_FA_PLUS
_INVITATION = (
    'Every shape in every texture. Drop objects on the square, or choose "Add to the sheet" from an object\'s menu; '
    "a click on the square adds A and B."
)


class SheetPanel:
    """Chosen objects along both borders, and every pair of them; a click makes a pair current."""

    title = "Sheet"
    dock = "Lower"

    def draw(self, desk: Desk) -> None:
        """The buttons, and the table as large as the panel allows."""
        if not desk.session.ready:
            imgui.text_disabled("The sheet comes with the model")
            return
        sheet = desk.session.sheet
        if sheet.names:
            self._draw_buttons(desk)
        count, gap = len(sheet.names) + 1, 0.2 * imgui.get_font_size()
        room = imgui.get_content_region_avail()
        side = max(2.0 * imgui.get_font_size(), min(room.x, room.y) / max(count, 4) - gap)
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        self._draw_corner(desk, side)
        for name in sheet.names:
            imgui.same_line()
            _draw_head(desk, name, "texture", side)
        for number, row in enumerate(sheet.rows):
            _draw_head(desk, row[0].shape, "shape", side)
            for column, pair in enumerate(row):
                imgui.same_line()
                _draw_cell(desk, f"pair {number + 1} {column + 1}", pair, side)
        imgui.pop_style_var()
        if not sheet.names:
            imgui.text_wrapped(_INVITATION)

    def _draw_buttons(self, desk: Desk) -> None:
        exporting, sheet = desk.session.exporting, desk.session.sheet
        if draw_progress(desk, "sheet"):
            return
        if button("Export sheet…###export sheet", "All pairs as one picture", enabled=not exporting.running):
            desk.files.ask(Wish("Export the sheet as", exporting.sheet, FORMATS, True, "sheet.png"))
        imgui.same_line()
        if button("Clear###clear sheet", "An empty sheet"):
            sheet.clear()

    def _draw_corner(self, desk: Desk, side: float) -> None:
        session, mix = desk.session, desk.session.state.mix
        enabled = len(session.sheet.names) < MOST
        imgui.begin_disabled(not enabled)
        if imgui.button(f"{_ADD}###add", (side, side)):
            session.sheet.add(*mix.a, mix.b)
        imgui.end_disabled()
        tip("Click to add A and B, or drop an object here" if enabled else f"{MOST} objects are the most")
        if dropped := faces.dropped(desk):
            session.sheet.add(dropped)


def _draw_head(desk: Desk, name: str, part: str, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    if imgui.invisible_button(f"{part} of {name}", (side, side)):
        desk.session.sheet.remove(name)
    tip(f"The {part} of {name}\nClick to take it off the sheet")
    faces.paint(desk, name, corner, side)
    edge = corner + (ImVec2(0, side - 2) if part == "texture" else ImVec2(side - 2, 0))
    line = packed(mixed(desk.palette.panel, desk.palette.text, 0.5))
    imgui.get_window_draw_list().add_rect_filled(edge, corner + ImVec2(side, side), line)


def _draw_cell(desk: Desk, label: str, pair: Pair, side: float) -> None:
    corner = imgui.get_cursor_screen_pos()
    if imgui.invisible_button(label, (side, side)):
        desk.session.show_pair(pair)
    tip(f"The shape of {pair.shape}\nin the texture of {pair.texture}")
    faces.paint_frame(desk, desk.session.sheet.picture(pair), corner, side)
    if desk.session.state.mix.a == pair:
        faces.frame(corner, side, desk.palette.accent)
