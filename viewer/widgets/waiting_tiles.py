"""Tiles of photos that are not fitted yet, among the added objects."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values.fit_history import FitRequest
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip
from viewer.widgets.text import caption

_CLOCK = icons_fontawesome_4.ICON_FA_CLOCK
_QUESTION = icons_fontawesome_4.ICON_FA_QUESTION
_WARNING = icons_fontawesome_4.ICON_FA_EXCLAMATION
_ROW = 3.2  # em, side of a tile in a row
_LINES = 2  # of tiles above a photo, so that forty waiting photos leave it in sight


def draw_row(context: PanelContext) -> None:
    """Draw the first unfinished requests in lines as wide as the panel, and the number of further ones."""
    pending = context.session.fitting.pending
    side = _ROW * hello_imgui.em_size()
    gap = imgui.get_style().item_spacing.x
    columns = max(1, int((imgui.get_content_region_avail().x + gap) / (side + gap)))
    for number, request in enumerate(pending[: _LINES * columns]):
        if number % columns:
            imgui.same_line()
        draw(context, request, imgui.get_cursor_screen_pos(), ImVec2(side, side))
    if len(pending) > _LINES * columns:
        caption(context, f"{len(pending) - _LINES * columns} more wait in the library")


def draw(context: PanelContext, waits: FitRequest, corner: ImVec2, size: ImVec2) -> None:
    """Draw a request's photo with a bar (running), a question mark (asked), a warning (failed) or a clock (queued).

    A click shows the fit or the question.
    """
    side = size.x
    fitting = context.session.fitting
    sources = waits.history.sources
    source = sources[0]
    name = f"waits {source.name}"
    running = fitting.running and sources is fitting.history.sources
    asked = any(question.request is waits for question in fitting.questions)
    imgui.push_id(id(sources) & 0x7FFFFFFF)  # the same photo may wait twice
    if object_tiles.tile_button(name, size) and (running or asked):
        context.focus = "Photo"
        if running:
            fitting.follow()
        else:
            fitting.ask_first(waits)
    question = fitting.question
    bright = imgui.is_item_hovered() or running or (question is not None and question.request is waits)
    object_tiles.paint_photo(context, source.file, corner, side)
    object_tiles.shade(corner, side, context.palette.panel, 0.0 if bright else object_tiles.DIMMED)
    if running:
        tooltip(f"{source.name} is being fitted\nClick to see it")
        _draw_bar(context, fitting.history.progress, corner, side)
    elif waits.problem:
        tooltip(f"{source.name} could not be fitted: {waits.problem}\nClick to try again")
        object_tiles.mark(corner, _WARNING, context.palette.error)
    elif asked:
        tooltip(f"{source.name} waits for an answer\nClick to see the question")
        object_tiles.mark(corner, _QUESTION, context.palette.warm)
    else:
        tooltip(f"{source.name} waits for {fitting.history.name}\nRight click to remove it")
        object_tiles.mark(corner, _CLOCK, context.palette.warm)
    _draw_menu(context, waits, name, running)
    imgui.pop_id()


def _draw_menu(context: PanelContext, waits: FitRequest, name: str, running: bool) -> None:
    """Draw the menu of imgui's last item, a waiting photo."""
    fitting = context.session.fitting
    if not imgui.begin_popup_context_item(name):
        return
    if running and imgui.menu_item_simple("Stop###stop fit"):
        fitting.stop()
    if not running and imgui.menu_item_simple("Remove###remove waiting"):
        fitting.forget(waits.history.sources)
    if waits.problem and imgui.menu_item_simple("Remove failed###remove failed"):
        fitting.remove_failed()
    imgui.end_popup()


def _draw_bar(context: PanelContext, progress: float, corner: ImVec2, side: float) -> None:
    low = corner.y + side
    height = 0.35 * hello_imgui.em_size()
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled((corner.x, low - height), (corner.x + side, low), packed(context.palette.raised))
    filled = corner.x + progress * side
    draw.add_rect_filled((corner.x, low - height), (filled, low), packed(context.palette.accent))
