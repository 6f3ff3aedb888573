"""Photos that are still to be rebuilt, as tiles among one's own objects."""

from imgui_bundle import ImVec2, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values.fit_history import FitRequest
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip

_CLOCK = icons_fontawesome_4.ICON_FA_CLOCK
_DIMMED = 0.45  # how much of the photo is hidden


def draw(context: PanelContext, waits: FitRequest, corner: ImVec2, size: ImVec2) -> None:
    """The photo with a clock; a click asks what to do with it."""
    side, fitting, source = size.x, context.session.fitting, waits.history.sources[0]
    name, sources = f"waits {source.name}", waits.history.sources
    imgui.push_id(id(sources) & 0x7FFFFFFF)  # the same photo may wait twice
    if imgui.invisible_button(name, size):
        imgui.open_popup(name)
    hovered = imgui.is_item_hovered()
    tooltip(f"{source.name} waits for {fitting.history.name}\nClick to rebuild it now, or to remove it")
    object_tiles.paint_photo(context, source.path, corner, side)
    shade = packed(context.palette.panel, 0.0 if hovered else _DIMMED)
    imgui.get_window_draw_list().add_rect_filled(corner, corner + ImVec2(side, side), shade, object_tiles.rounding())
    object_tiles.mark(corner, _CLOCK, context.palette.warm)
    if imgui.begin_popup_context_item(name):
        if imgui.menu_item_simple("Do it now###do it now"):
            fitting.begin_now(sources)
        stays = "stays as it is" if fitting.results.checking else "waits then, and begins anew"
        tooltip(f"{fitting.history.name} {stays}")
        if imgui.menu_item_simple("Remove###remove waiting"):
            fitting.forget(sources)
        imgui.end_popup()
    imgui.pop_id()
