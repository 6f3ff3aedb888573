"""The program: a session, its panels, and the window around them."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import moderngl
import torch
from imgui_bundle import hello_imgui, imgui

from core.models.library import shipped_models
from viewer.actions import run_keys
from viewer.autosave import Autosave
from viewer.context import Panel, PanelContext
from viewer.panels import all_panels, help, menu, messages, recovery, running_fit
from viewer.panels.segmenting import SegmentingDialog
from viewer.screen import theme, window
from viewer.screen.canvas import Canvas, Images
from viewer.screen.file_dialog import FileDialog, is_there
from viewer.services.messages import error_text
from viewer.services.mine import Mine
from viewer.services.worker import Job
from viewer.session import Session
from viewer.values.preferences import Preferences
from viewer.values.quality import QUALITIES

_RATE, _RATE_BESIDE_WORKER, _RATE_OF_PROGRESS = 60.0, 30.0, 8.0
"""Frames per second at the most; the second where OpenGL and the worker share the processor, the third where nobody
touches anything meanwhile."""
_TOUCHED = 0.7
"""s for which a touch counts."""


class App:
    """Panels docked in a window; see :meth:`run`."""

    def __init__(
        self,
        session: Session,
        size: tuple[int, int] = (1280, 800),
        folder: Path | None = None,
        headless: bool = False,
        native_dialogs: bool | None = None,
    ) -> None:
        """Nothing opens yet.

        Args:
            folder: where layout and preferences are kept for the next time; None keeps nothing.
            headless: draw a window that nobody sees.
            native_dialogs: None: as the system has them.
        """
        window.prepare(headless)
        self.session = session
        self.context = PanelContext(
            session, FileDialog(native_dialogs), quit=self._quit, reset_layout=self._reset_layout
        )
        self.panels: list[Panel] = all_panels()
        self._segmenting = SegmentingDialog()
        self.params = window.parameters(size, folder)
        self.each_frame: Callable[[], None] = lambda: None
        self._size, self._folder, self._headless = size, folder, headless
        if folder:
            self.context.preferences = Preferences.load(folder)
            session.view.quality = QUALITIES[self.context.preferences.quality]
            session.mine = Mine(folder / "mine")
            self.context.autosave = Autosave(session, folder)
        self._saved_preferences = self.context.preferences
        self._gl: moderngl.Context | None = None
        self._software, self._touched = False, 0.0
        self._themed: bool | None = None
        self._failed: dict[str, str] = {}
        if headless:
            window.make_headless(self.params, self._finish_frame)
        self._dock()
        self._connect()

    @property
    def last_model(self) -> str:
        """The name of the model that was open when the last run ended; empty where there is no such model any more."""
        name = self.context.autosave.model if self.context.autosave else ""
        return name if name in shipped_models() or is_there(Path(name)) else ""

    def run(self) -> None:
        """Open the window; returns when it is closed."""
        window.run(self.params)

    def _finish_frame(self) -> None:
        assert self._gl is not None, "no window yet"
        self._gl.finish()

    def _quit(self) -> None:
        self.params.app_shall_exit = True

    def _reset_layout(self) -> None:
        self.params.docking_params.layout_reset = True

    def _connect(self) -> None:
        calls = self.params.callbacks
        calls.load_additional_fonts = theme.load_fonts
        calls.setup_imgui_style = theme.set_spacing
        calls.post_init = self._opened
        calls.before_exit = self._closing
        calls.pre_new_frame = self._before_frame
        calls.show_gui = self._draw
        calls.show_menus = self._draw_menus
        self.session.jobs.worker.wake = hello_imgui.request_refresh

    def _dock(self) -> None:
        window_params = self.params.imgui_window_params
        window_params.show_menu_bar = True
        window_params.show_menu_app = window_params.show_menu_view = False
        window_params.show_menu_view_themes = False
        right, down, up = imgui.Dir.right, imgui.Dir.down, imgui.Dir.up
        docking = self.params.docking_params
        docking.main_dock_space_node_flags = imgui.DockNodeFlags_.auto_hide_tab_bar
        docking.docking_splits = [
            hello_imgui.DockingSplit("MainDockSpace", "Upper", right, 0.36),
            hello_imgui.DockingSplit("Upper", "Lower", down, 0.5),
            hello_imgui.DockingSplit("Upper", "Top", up, 0.34),
            hello_imgui.DockingSplit("MainDockSpace", "Strip", down, 0.23),
        ]
        docking.dockable_windows = [self._dockable(panel) for panel in self.panels]

    def _dockable(self, panel: Panel) -> hello_imgui.DockableWindow:
        place = "MainDockSpace" if panel.dock == "View" else panel.dock
        closable = panel.dock != "View"
        return hello_imgui.DockableWindow(panel.title, place, lambda: self._draw_panel(panel), can_be_closed_=closable)

    def _draw_panel(self, panel: Panel) -> None:
        """Draw a panel; one that fails says so, and the others work on."""
        if panel.waiting and not self.context.ready:
            imgui.text_disabled(panel.waiting)
            return
        if panel.title in self._failed:
            imgui.text_wrapped(f"This panel failed: {self._failed[panel.title]}")
            if imgui.button("Try again"):
                del self._failed[panel.title]
            return
        if error := self._guard(f"The panel {panel.title} failed", lambda: panel.draw(self.context)):
            self._failed[panel.title] = error_text(error)

    def _guard(self, what: str, draw: Callable[[], None]) -> Exception | None:
        """Draw something; a failure is reported and returned, and does not end the program."""
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        try:
            draw()
        except Exception as error:
            imgui.internal.error_recovery_try_to_recover_state(state)
            self.session.messages.report(what, error)
            return error
        return None

    def _opened(self) -> None:
        self._gl = moderngl.get_context()
        self._software = window.in_software(self._gl)
        if self._software:
            self.session.jobs.submit(Job("threads", _leave_a_core, lambda _: None))
        self.context.canvas, self.context.images = Canvas(self._gl), Images(self._gl)
        # A mistake in a panel is logged by imgui, and does not end the program.
        io = imgui.get_io()
        io.config_error_recovery_enable_assert = io.config_error_recovery_enable_tooltip = False
        window.on_drop(self._dropped)
        if self._headless:
            window.resize(*self._size)

    def _dropped(self, paths: list[str]) -> None:
        try:
            self.context.drop(paths)
        except Exception as error:  # glfw would keep it, and raise it in some later call
            self.session.messages.report("Cannot take this file", error)

    def _closing(self) -> None:
        self.session.jobs.worker.close()
        if self.context.autosave:
            self.context.autosave.close()
        self._save_preferences()
        assert self.context.canvas and self.context.images
        self.context.canvas.release()
        self.context.images.release()

    def _before_frame(self) -> None:
        try:
            self.session.tick()
            self.context.follow_fit()
            if self.context.autosave:
                self.context.autosave.tick()
        except Exception as error:  # of one callback; the others run in the next frame
            self.session.messages.report("Something went wrong", error)
        preferences = self.context.preferences
        if preferences.dark != self._themed:
            self._themed = preferences.dark
            theme.apply(self.context.palette)
            self.params.imgui_window_params.background_color = imgui.ImVec4(*self.context.palette.back, 1.0)
        imgui.get_style().font_scale_main = preferences.text
        if not self._headless:
            self.params.fps_idling.fps_max = self._rate()
        self.each_frame()

    def _rate(self) -> float:
        io = imgui.get_io()
        if any(io.mouse_delta) or any(io.mouse_down) or io.mouse_wheel or imgui.is_any_item_active():
            self._touched = time.monotonic()
        if not (self._software and self.session.jobs.busy()):
            return _RATE
        return _RATE_BESIDE_WORKER if time.monotonic() - self._touched < _TOUCHED else _RATE_OF_PROGRESS

    def _draw_menus(self) -> None:
        self._guard("The menu failed", lambda: menu.draw(self.context))

    def _draw(self) -> None:
        """All that is not docked."""
        context = self.context
        self._guard("This key failed", lambda: run_keys(context))
        self._guard("The messages failed", lambda: messages.draw(context))
        self._guard("The help failed", lambda: help.draw(context))
        self._guard("The last session cannot be offered", lambda: recovery.draw(context))
        if context.ready:
            self._guard("The fit cannot be shown", lambda: running_fit.draw(context))
        self._guard("Cannot take this file", context.files.draw)
        if context.ready and self._guard("The photo cannot be segmented", lambda: self._segmenting.draw(context)):
            context.segmenting.close()
        for title in filter(None, (context.focus_other_dock, context.focus)):
            self.params.docking_params.focus_dockable_window(title)
        context.focus_other_dock = context.focus = ""
        assert context.images is not None
        context.images.sweep()
        if not imgui.is_any_mouse_down():
            self._save_preferences()

    def _save_preferences(self) -> None:
        """Write them as soon as they change, so that a crash does not lose them."""
        if self._folder and self.context.preferences != self._saved_preferences:
            self._saved_preferences = self.context.preferences
            try:
                self._saved_preferences.save(self._folder)
            except (ValueError, OSError) as error:
                self.session.messages.report("Cannot save the preferences", error)


def _leave_a_core() -> Iterator[None]:
    """Beside a window that the processor renders, threads that wait for each other are slower than one thread less."""
    torch.set_num_threads(max(1, torch.get_num_threads() - 1))
    yield None
