"""Grey tiles of what cannot be shown: objects and states of missing models."""

from pathlib import Path

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values.state import State
from viewer.values.variety import readable
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip
from viewer.widgets.text import paint_caption, small_height

_FILE = icons_fontawesome_4.ICON_FA_UNLINK


def draw_object(context: PanelContext, name: str, corner: ImVec2, size: ImVec2) -> None:
    """Draw an object whose model is missing; a click or its menu asks for the model's file."""
    session = context.session
    model = session.editor.objects[name].instance.fingerprint
    file = session.model_name(model)

    def find() -> None:
        context.find_model(model, lambda: session.editor.show_object(name))

    if object_tiles.tile_button(f"show {name}", size):
        find()
    tooltip(f"{readable(name)} needs its model, {file}, which is not there\nClick to find it, right click for more")
    if imgui.begin_popup_context_item():
        if imgui.menu_item_simple("Find…###find model"):
            find()
        if imgui.menu_item_simple("Remove###remove object"):
            session.remove(name)
        imgui.end_popup()
    paint(context, file, corner, size.x)


def draw_state(context: PanelContext, state: State, words: str, name: str, side: float) -> None:
    """Draw a state of the history that cannot be shown, described in words; a click asks for the model's file."""
    session = context.session
    corner = imgui.get_cursor_screen_pos()
    model = state.scene.instance.fingerprint
    is_missing = state.scene.instance.is_missing
    if object_tiles.tile_button(name, (side, side)) and is_missing:
        context.find_model(model, lambda: session.editor.show_state(state))
    needs = f"Needs {session.model_name(model)}, which is not there: {words}\nClick to find it"
    tooltip(needs if is_missing else f"Cannot be shown, as one of its objects is missing: {words}")
    paint(context, "", corner, side)


def paint(context: PanelContext, file: str, corner: ImVec2, side: float) -> None:
    """Draw a grey square with a broken link above the name of a file, if any, without its ending."""
    object_tiles.shade(corner, side, context.palette.raised)
    if imgui.is_item_hovered():
        object_tiles.shade(corner, side, (1, 1, 1), 0.12)
    room = 1.2 * small_height() if file else 0.0
    middle = corner + ImVec2(side, side - room) * 0.5
    low = middle - imgui.calc_text_size(_FILE) * 0.5
    imgui.get_window_draw_list().add_text(low, packed(context.palette.quiet), _FILE)
    gap = 0.15 * hello_imgui.em_size()
    paint_caption(context, Path(file).stem, corner + ImVec2(gap, side - room), side - 2 * gap)
