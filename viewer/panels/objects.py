"""The objects as thumbnails."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import PanelContext
from viewer.screen.theme import WARM, Colour, packed
from viewer.values.history import PARTS
from viewer.widgets import mine, object_tiles
from viewer.widgets.controls import tooltip

_CELL = 4.6
"""em"""


class ObjectsPanel:
    """Click one to show it (it is A), drag it to a slot, or right click it to choose."""

    title = "Objects"
    dock = "Upper"
    waiting = "The objects come with the model"

    def __init__(self) -> None:
        self._mine_menu = mine.MineMenu()

    def draw(self, context: PanelContext) -> None:
        """All objects; those out of sight are not rendered."""
        if imgui.begin_child("grid"):
            self._draw_grid(context)
        imgui.end_child()
        self._mine_menu.apply(context)

    def _draw_grid(self, context: PanelContext) -> None:
        names, em = context.editor.objects.names, hello_imgui.em_size()
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
                _cell(context, name, side, self._mine_menu)
        imgui.pop_style_var()


def _cell(context: PanelContext, name: str, side: float, mine_menu: mine.MineMenu) -> None:
    editor, corner = context.editor, imgui.get_cursor_screen_pos()
    if imgui.invisible_button(f"show {name}", (side, side)):
        editor.show_object(name)
    hovered = imgui.is_item_hovered()
    tooltip(f"{name}{mine.about(editor.objects[name])}\nClick to show it, drag it to a slot, right click to choose")
    if imgui.begin_drag_drop_source():
        context.dragged = name
        imgui.set_drag_drop_payload_py_id(object_tiles.DRAGGED, 0)
        imgui.text(name)
        imgui.end_drag_drop_source()
    if imgui.begin_popup_context_item():
        _draw_menu(context, name)
        if name in [one.name for one in editor.objects.added]:
            mine_menu.draw(context, name)
        imgui.end_popup()
    object_tiles.paint(context, name, corner, side)
    draw = imgui.get_window_draw_list()
    for number, (label, colour) in enumerate(_marks(context, name)):
        object_tiles.outline(corner, side, colour, inset=2.0 * number)
        object_tiles.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), label, colour)
    if hovered:
        draw.add_rect_filled(corner, corner + ImVec2(side, side), packed((1, 1, 1), 0.12), object_tiles.rounding())
    mine.draw_dot(context, name, corner, side)


def _draw_menu(context: PanelContext, name: str) -> None:
    editor = context.editor
    if imgui.menu_item_simple("Show it"):
        editor.show_object(name)
    for part in PARTS:
        if imgui.menu_item_simple(f"Take only its {part}", enabled=part not in editor.locked):
            editor.take(part, name)
    if imgui.menu_item_simple("Make it B"):
        editor.set_b(name)
    if imgui.menu_item_simple("Add to the grid"):
        context.grid.add(name)
        context.focus = "Grid"


def _marks(context: PanelContext, name: str) -> list[tuple[str, Colour]]:
    """What an object is just now: A, what A's shape or texture was taken from, B."""
    mix, accent = context.editor.state.mix, context.palette.accent
    if mix.a == (name, name):
        marks = [("A", accent)]
    else:
        marks = [(object_tiles.ICONS[part], accent) for part in PARTS if getattr(mix.a, part) == name]
    return [*marks, ("B", WARM)] if mix.b == name else marks
