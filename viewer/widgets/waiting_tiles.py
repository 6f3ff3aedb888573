"""Photos that are still to be rebuilt, as tiles among one's own objects."""

from imgui_bundle import ImVec2, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values.fit_history import Waiting
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip

_CLOCK = icons_fontawesome_4.ICON_FA_CLOCK
_DIMMED = 0.45
"""how much of the photo is hidden"""


def draw(context: PanelContext, waits: Waiting, corner: ImVec2, size: ImVec2) -> None:
    """The photo with a clock; a click asks what to do with it."""
    side, name = size.x, f"waits {waits.name}"
    imgui.push_id(id(waits.sources) & 0x7FFFFFFF)  # the same photo may wait twice
    if imgui.invisible_button(name, size):
        imgui.open_popup(name)
    hovered = imgui.is_item_hovered()
    tooltip(f"{waits.name} {_reason(context, waits)}\nClick to rebuild it now, or to remove it")
    object_tiles.paint_photo(context, waits.sources[0].path, corner, side)
    shade = packed(context.palette.panel, 0.0 if hovered else _DIMMED)
    imgui.get_window_draw_list().add_rect_filled(corner, corner + ImVec2(side, side), shade, object_tiles.rounding())
    object_tiles.mark(corner, _CLOCK, context.palette.warm)
    if imgui.begin_popup_context_item(name):
        _draw_menu(context, waits)
        imgui.end_popup()
    imgui.pop_id()


def _draw_menu(context: PanelContext, waits: Waiting) -> None:
    if imgui.menu_item_simple("Do it now###do it now"):
        context.session.do_now(waits)
    tooltip(_price(context, waits))
    if imgui.menu_item_simple("Remove###remove waiting"):
        context.session.forget(waits)


def _reason(context: PanelContext, waits: Waiting) -> str:
    """What it waits for."""
    running, export = context.fitting.running, context.exporting.path
    until = context.fitting.history.name if running else export.name if export and waits.category else ""
    opens = f"{waits.category.capitalize()} opens for it" if waits.category else ""
    return " ".join(filter(None, (f"waits for {until}." if until else "waits.", opens)))


def _price(context: PanelContext, waits: Waiting) -> str:
    """What happens to that."""
    fitting, export = context.fitting, context.exporting.path
    if waits.category and export:
        return f"{export.name} is given up"
    if not fitting.running:
        return "Nothing is in its way"
    if fitting.results.checking:
        return f"{fitting.history.name} stays as it is"
    return f"{fitting.history.name} waits then, and begins anew"
