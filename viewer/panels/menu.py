"""The menu bar, made from the table of actions."""

from collections.abc import Callable
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from viewer.actions import ACTIONS
from viewer.context import PanelContext
from viewer.values.printable import as_label, printable
from viewer.widgets.controls import draw_progress, tooltip

_EXPORT = 19  # em, width of an export's bar with its button
_GAP = 1.5  # em between menus, message and the export's bar


def draw(context: PanelContext, draw_message: Callable[[PanelContext, float], None]) -> None:
    """Draw the menus, a message on the px that are left and, on the right, the progress of an export."""
    for title, entries in MENUS.items():
        _menu(context, title, entries)
    em = hello_imgui.em_size()
    exporting = _EXPORT * em if context.session.exporting.running else 0.0
    imgui.same_line(0, _GAP * em)
    end = imgui.get_window_width() - exporting - _GAP * em
    draw_message(context, end - imgui.get_cursor_pos_x())
    if exporting:
        imgui.same_line(max(end, imgui.get_cursor_pos_x()))
        draw_progress(context, width=_EXPORT)


def _menu(context: PanelContext, title: str, entries: tuple[str | Callable[[PanelContext], None] | None, ...]) -> None:
    """Draw a menu of actions (ids), sub-menus (functions) and separators (None)."""
    if not imgui.begin_menu(title):
        return
    for entry in entries:
        if entry is None:
            imgui.separator()
        elif isinstance(entry, str):
            _draw_item(context, entry)
        else:
            entry(context)
    imgui.end_menu()


def _draw_item(context: PanelContext, name: str) -> None:
    action = ACTIONS[name]
    keys = action.keys.partition(",")[0]
    if imgui.menu_item_simple(f"{action.words}###{name}", keys, enabled=action.enabled(context)):
        action.run(context)
    tooltip(action.tooltip[:1].upper() + action.tooltip[1:])


def _draw_panels(context: PanelContext) -> None:
    """Draw the menu that shows and hides panels."""
    docking = hello_imgui.get_runner_params().docking_params
    for label in [panel.label for panel in docking.dockable_windows if panel.can_be_closed]:
        panel = docking.dockable_window_of_name(label)
        panel.is_visible = imgui.menu_item(label, "", panel.is_visible)[1]


def _draw_recent(context: PanelContext) -> None:
    recent = context.preferences.recent
    if imgui.begin_menu("Recent", bool(recent or context.session.store.earlier)):
        for number, name in enumerate(recent):
            if imgui.menu_item_simple(f"{as_label(printable(Path(name).name))}###recent {number + 1}"):
                context.drop([name])
            tooltip(name)
        imgui.separator()
        for number, session in enumerate(context.session.store.earlier):  # which New or another project replaced
            if imgui.menu_item_simple(f"{as_label(printable(session.name))}###earlier {number + 1}"):
                context.session.open_earlier(session)
        imgui.end_menu()


MENUS: dict[str, tuple[str | Callable[[PanelContext], None] | None, ...]] = {
    "File": ("open_scene", "save_project", "share", _draw_recent, "new_project"),
    "Edit": ("undo", "redo", "reset", None, "paste", "copy_image"),
    "View": (
        *("see_front", "see_side", "see_top", "see_photo", "reset_view"),
        *(None, "dark", "larger_text", "smaller_text"),
    ),
    "Panels": (_draw_panels, None, "fold_panels", "reset_layout"),
    "Help": ("help",),
}  # actions (ids), sub-menus and separators (None); every action without a key is here
