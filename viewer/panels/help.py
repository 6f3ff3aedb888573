"""The help window: the table of actions with mouse and keys, and a search in it."""

from collections.abc import Iterable

from imgui_bundle import hello_imgui, imgui

from viewer.actions import TABLE, Action, Gesture, find_actions
from viewer.context import PanelContext
from viewer.widgets.text import heading

_WHAT, _DOES = 13, 32  # em: the widths of the columns


def draw(context: PanelContext) -> None:
    """A window, while it is open."""
    if not context.help_open:
        return
    viewport = imgui.get_main_viewport()
    imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0, 0), viewport.work_size)  # a low window scrolls
    flags = imgui.WindowFlags_
    unmoved = flags.no_saved_settings | flags.no_docking | flags.no_collapse | flags.always_auto_resize
    shown, stays = imgui.begin("Help", True, unmoved)
    context.help_open = bool(stays)
    if shown:
        _draw_search(context)
    if shown and imgui.begin_table("help", 2):
        imgui.table_setup_column("what", imgui.TableColumnFlags_.width_fixed, hello_imgui.em_size(_WHAT))
        room = viewport.work_size.x - hello_imgui.em_size(_WHAT + 3)
        does = min(hello_imgui.em_size(_DOES), room)
        imgui.table_setup_column("does", imgui.TableColumnFlags_.width_fixed, does)
        for place, rows in TABLE.items():
            _draw_place(context, place, [row for row in map(_columns, rows) if _matches(context, (place, *row))])
        imgui.end_table()
    imgui.end()


def _draw_search(context: PanelContext) -> None:
    if imgui.is_window_appearing():
        context.help_search = ""
        imgui.set_keyboard_focus_here()
    imgui.set_next_item_width(-1)
    if imgui.get_io().want_text_input and imgui.is_key_pressed(imgui.Key.f1, False):
        context.help_open = False
    hint = "Type what you look for; Enter does the first"
    context.help_search = imgui.input_text_with_hint("##search", hint, context.help_search)[1]
    found = [action for action in find_actions(context.help_search) if action.enabled(context)]
    if found:
        imgui.text_colored((*context.palette.accent, 1.0), f"Enter: {found[0].words}")
    if found and any(map(imgui.is_key_pressed, (imgui.Key.enter, imgui.Key.keypad_enter))):
        context.help_open = False
        found[0].run(context)


def _columns(row: Action | Gesture) -> tuple[str, str]:
    return (row.keys or row.words) if isinstance(row, Action) else row.words, row.tooltip


def _matches(context: PanelContext, texts: Iterable[str]) -> bool:
    return context.help_search.lower() in " ".join(texts).lower()


def _draw_place(context: PanelContext, place: str, rows: list[tuple[str, str]]) -> None:
    """What works in one place, under its name; nothing where the search finds nothing."""
    if rows:
        imgui.table_next_row()
        imgui.table_next_column()
        heading(context, place)
    for what, does in rows:
        imgui.table_next_row()
        imgui.table_next_column()
        imgui.text(what)
        imgui.table_next_column()
        imgui.text_wrapped(does)
