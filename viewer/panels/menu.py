"""The menu bar, made of the table of actions."""

from collections.abc import Callable
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from viewer.actions import ACTIONS
from viewer.context import PanelContext
from viewer.values.printable import printable
from viewer.widgets.controls import draw_progress, tooltip

_EXPORT = 19  # em: the bar of the file under way, and its button


def draw(context: PanelContext) -> None:
    """Menus, and at the right what is under way."""
    for title, entries in MENUS.items():
        _menu(context, title, entries)
    _draw_status(context)


def _menu(context: PanelContext, title: str, entries: tuple[str | Callable[[PanelContext], None] | None, ...]) -> None:
    """A menu of actions by their ids, of sub-menus, and of lines (None) between them."""
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
    if imgui.menu_item(f"{action.words}###{name}", keys, action.checked(context), action.enabled(context))[0]:
        action.run(context)
    tooltip(action.tooltip[:1].upper() + action.tooltip[1:])


def _draw_panels(context: PanelContext) -> None:
    """Which panels are shown."""
    docking = hello_imgui.get_runner_params().docking_params
    for label in [panel.label for panel in docking.dockable_windows if panel.can_be_closed]:
        panel = docking.dockable_window_of_name(label)
        panel.is_visible = imgui.menu_item(label, "", panel.is_visible)[1]


def _draw_samples(context: PanelContext) -> None:
    if imgui.begin_menu("Samples", ACTIONS["fit_image"].enabled(context)):
        for path in context.session.samples:
            if imgui.menu_item_simple(path.stem):
                context.fit(path)
        imgui.end_menu()


def _draw_recent(context: PanelContext) -> None:
    recent = context.preferences.recent
    if imgui.begin_menu("Open recent", bool(recent)):
        for number, name in enumerate(recent):
            if imgui.menu_item_simple(f"{printable(Path(name).name)}###recent {number + 1}"):
                context.drop([name])
            tooltip(printable(name))
        imgui.end_menu()


def _draw_earlier(context: PanelContext) -> None:
    """Sessions that New or another project has replaced."""
    earlier = context.autosave.earlier if context.autosave else ()
    if imgui.begin_menu("Earlier sessions", bool(earlier)):
        for number, path in enumerate(earlier):
            if imgui.menu_item_simple(f"{path.stem[:19]}###earlier {number + 1}"):
                context.session.open_project(path, keep_path=False)
        imgui.end_menu()


def _draw_status(context: PanelContext) -> None:
    session, parts = context.session, list[str]()
    if preparing := session.preparing:
        parts.append(f"Preparing {preparing:.0%}")
    if session.fitting.running:
        parts.append(f"Rebuilding {session.fitting.history.progress:.0%}")
    parts.append(f"{len(session.editor.objects.names)} objects")
    text = "      ".join(parts)
    exporting = hello_imgui.em_size(_EXPORT) if context.session.exporting.running else 0.0
    width = imgui.calc_text_size(text).x + 2 * hello_imgui.em_size() + exporting
    imgui.same_line()
    if exporting:
        shown = min(imgui.get_content_region_avail().x, width)
        imgui.same_line(imgui.get_window_width() - shown)
        draw_progress(context, width=_EXPORT)
        imgui.same_line()
        width -= exporting
    if imgui.get_content_region_avail().x > width:  # else it would lie over the menus
        imgui.same_line(imgui.get_window_width() - width)
        imgui.text_disabled(text)


MENUS: dict[str, tuple[str | Callable[[PanelContext], None] | None, ...]] = {
    "File": (
        *("fit_image", "paste", _draw_samples, None),
        *("new_project", "open_scene", _draw_recent, _draw_earlier, None, "save_project", "save_project_as", None),
        *("save_scene", "share", None, "quit"),
    ),
    "Edit": ("undo", "redo", None, "copy_image", "copy_camera", "paste_camera"),
    "View": (
        *("dark", "smooth", "shadow", "idle_turn", None, "reset_view", "follow"),
        *(None, "larger_text", "smaller_text"),
    ),
    "Panels": (_draw_panels, None, "reset_layout"),
    "Help": ("help",),
}  # Actions by their ids, sub-menus, and lines (None); what has no key has its place here.
