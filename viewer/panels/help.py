"""The help window: the table of actions with mouse and keys."""

from imgui_bundle import hello_imgui, imgui

from viewer.actions import TABLE, Action
from viewer.context import PanelContext

_WHAT, _DOES = 13, 32
"""em: the widths of the columns"""


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
    if shown and imgui.begin_table("help", 2):
        imgui.table_setup_column("what", imgui.TableColumnFlags_.width_fixed, hello_imgui.em_size(_WHAT))
        room = viewport.work_size.x - hello_imgui.em_size(_WHAT + 3)
        does = min(hello_imgui.em_size(_DOES), room)
        imgui.table_setup_column("does", imgui.TableColumnFlags_.width_fixed, does)
        for place, rows in TABLE.items():
            _draw_row(place, "", heading=True)
            for row in rows:
                _draw_row((row.keys or row.words) if isinstance(row, Action) else row.words, row.tooltip)
        imgui.end_table()
    imgui.end()


def _draw_row(what: str, does: str, heading: bool = False) -> None:
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.text_disabled(what) if heading else imgui.text(what)
    imgui.table_next_column()
    imgui.text_wrapped(does)
