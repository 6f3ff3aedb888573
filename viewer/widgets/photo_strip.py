"""The photos of an object in a row, with a plus for another; their menus name their sides."""

from functools import partial

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.classifiers.viewpoint import SIDES, Side, unseen_side
from core.fitting.problem import MOST_PHOTOS
from core.models.photo_detail import PhotoDetail
from core.photos.decode import IMAGE_SUFFIXES
from viewer.context import PanelContext
from viewer.screen.file_dialog import FileRequest
from viewer.values.fit_history import FitHistory
from viewer.widgets import object_tiles
from viewer.widgets.controls import button, tooltip
from viewer.widgets.text import paint_on_plate

_TILE, _GAP = 3.2, 0.4  # em
_PLUS = icons_fontawesome_4.ICON_FA_PLUS
_PLUS_HELP = "Another photo of the same object: each makes its other sides better"
_MENU_HELP = "Right click to say which side it shows, or to take it out"


def draw_strip(context: PanelContext, history: FitHistory) -> None:
    """Draw the photos of the shown fit as tiles; a click selects one. A plus adds another."""
    fitting = context.session.fitting
    side = _TILE * hello_imgui.em_size()
    gap = _GAP * hello_imgui.em_size()
    columns = max(1, int((imgui.get_content_region_avail().x + gap) / (side + gap)))
    can_change = bool(history.photos) and history is fitting.shown and not fitting.running
    for number in range(len(history.sources)):
        if number % columns:
            imgui.same_line(0, gap)
        _draw_photo(context, history, number, side, can_change)
    if not can_change or len(history.sources) >= MOST_PHOTOS:
        return
    if len(history.sources) % columns:
        imgui.same_line(0, gap)
    if imgui.button(f"{_PLUS}###add photo", (side, side)):
        ask_for_photo(context, history)
    tooltip(_PLUS_HELP)


def draw_unseen_side(context: PanelContext, history: FitHistory, detail: PhotoDetail) -> None:
    """Name the side that no photo shows, the top last, with a button for a photo of it."""
    side = unseen_side(detail.azimuths, max(view.camera.elevation for view in detail.views))
    if side is None or not history.photos or len(history.sources) >= MOST_PHOTOS:
        return
    imgui.align_text_to_frame_padding()
    imgui.text_wrapped(f"The {_name(side)} is a guess.")
    imgui.same_line()
    if button(f"Add a photo of it###add {side}", _PLUS_HELP):
        ask_for_photo(context, history, side)


def ask_for_photo(context: PanelContext, history: FitHistory, side: Side | None = None) -> None:
    """Ask for another photo of an object, which is refined with it.

    Args:
        side: of the object that the photo shows, if it is known.
    """
    title = f"Photo of the {_name(side)} of the same object" if side else "Another photo of the same object"
    add = partial(context.session.fitting.add_photo, history, side=side)
    context.files.ask(FileRequest(title, add, IMAGE_SUFFIXES))


def _name(side: Side) -> str:
    return "top" if side == "above" else side


def _draw_photo(context: PanelContext, history: FitHistory, number: int, side: float, can_change: bool) -> None:
    fitting = context.session.fitting
    source = history.sources[number]
    corner = imgui.get_cursor_screen_pos()
    can_select = number < len(history.photos) and history is fitting.history
    if object_tiles.tile_button(f"photo {number + 1}", ImVec2(side, side)) and can_select:
        fitting.view.show_photo(number)
    words = f"{source.name}, the {source.side}" if source.side else source.name
    tooltip(f"{words}\n{_MENU_HELP}" if can_change else words)
    if can_change:
        _draw_menu(context, history, number)
    object_tiles.paint_photo(context, source.file, corner, side)
    step = history.last
    if step and number in step.left_out:
        object_tiles.shade(corner, side, context.palette.panel, object_tiles.DIMMED)
    selected = number == history.photo_index and len(history.sources) > 1
    object_tiles.outline(corner, side, context.palette.accent if selected else context.palette.line)
    if source.side:
        pad = ImVec2(0.2, 0.0) * hello_imgui.em_size()
        paint_on_plate(corner + ImVec2(pad.x, side - imgui.get_text_line_height()), source.side.capitalize(), pad)


def _draw_menu(context: PanelContext, history: FitHistory, number: int) -> None:
    """Draw the menu of imgui's last item, a photo: the side that it shows, and its removal."""
    fitting = context.session.fitting
    if not imgui.begin_popup_context_item(f"photo {number + 1} menu"):
        return
    source = history.sources[number]
    for name in SIDES:
        label = f"From above###side {name}" if name == "above" else f"The {name}###side {name}"
        if imgui.menu_item_simple(label, selected=name == source.side):
            fitting.fit_again(history.with_side(number, None if name == source.side else name))
    if len(history.sources) > 1:
        imgui.separator()
        if imgui.menu_item_simple("Take this photo out###remove photo"):
            fitting.refine(history, without=(number,))
    imgui.end_popup()
