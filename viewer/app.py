"""The program: a session, its panels, and the window around them."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import moderngl
import torch
from imgui_bundle import hello_imgui, imgui

from viewer.autosave import Autosave
from viewer.context import Desk, Panel
from viewer.panels import all_panels, help, menu, messages, recovery
from viewer.panels.segmenting import CuttingDialog
from viewer.screen import theme, window
from viewer.screen.canvas import Canvas, Images
from viewer.screen.file_dialog import Files
from viewer.services.messages import explain
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
            native_dialogs: None asks the system whether it has them.
        """
        window.prepare(headless)
        self.session = session
        self.desk = Desk(session, Files(native_dialogs), quit=self._quit, reset_layout=self._reset_layout)
        self.panels: list[Panel] = all_panels()
        self._cutting = CuttingDialog()
        self.params = window.parameters(size, folder)
        self.each_frame: Callable[[], None] = lambda: None
        self._size, self._folder, self._headless = size, folder, headless
        if folder:
            self.desk.likes = Preferences.load(folder)
            session.viewport.quality = QUALITIES[self.desk.likes.quality]
            self.desk.autosave = Autosave(session, folder)
        self._kept = self.desk.likes
        self._context: moderngl.Context | None = None
        self._software, self._touched = False, 0.0
        self._themed: bool | None = None
        self._failed: dict[str, str] = {}
        if headless:
            window.make_headless(self.params, self._gl)
        self._dock()
        self._connect()

    def run(self) -> None:
        """Open the window; returns when it is closed."""
        window.run(self.params)

    def _gl(self) -> moderngl.Context:
        assert self._context is not None, "no window yet"
        return self._context

    def _quit(self) -> None:
        self.params.app_shall_exit = True

    def _connect(self) -> None:
        calls = self.params.callbacks
        calls.load_additional_fonts = theme.load_fonts
        calls.setup_imgui_style = theme.set_spacing
        calls.post_init = self._opened
        calls.before_exit = self._closing
        calls.pre_new_frame = self._before_frame
        calls.show_gui = self._draw
        calls.show_menus = self._draw_menus
        self.session.worker.wake = hello_imgui.request_refresh

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
        return hello_imgui.DockableWindow(panel.title, place, lambda: self._guarded(panel), can_be_closed_=closable)

    def _guarded(self, panel: Panel) -> None:
        """Draw a panel; one that fails says so, and the others go on."""
        if panel.title in self._failed:
            imgui.text_wrapped(f"This panel failed: {self._failed[panel.title]}")
            if imgui.button("Try again"):
                del self._failed[panel.title]
            return
        if error := self._safely(f"The panel {panel.title} failed", lambda: panel.draw(self.desk)):
            self._failed[panel.title] = explain(error)

    def _safely(self, what: str, draw: Callable[[], None]) -> Exception | None:
        """Draw something; a failure is told, returned, and does not end the program."""
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        try:
            draw()
        except Exception as error:
            imgui.internal.error_recovery_try_to_recover_state(state)
            self.session.report(what, error)
            return error
        return None

    def _opened(self) -> None:
        self._context = moderngl.get_context()
        self._software = window.in_software(self._context)
        if self._software:
            self.session.worker.submit(Job("threads", _sparing_a_core, lambda _: None))
        self.desk.canvas, self.desk.images = Canvas(self._context), Images(self._context)
        # A mistake in a panel is logged by imgui, and does not end the program.
        io = imgui.get_io()
        io.config_error_recovery_enable_assert = io.config_error_recovery_enable_tooltip = False
        window.on_drop(self._dropped)
        if self._headless:
            window.resize(*self._size)

    def _dropped(self, paths: list[str]) -> None:
        try:
            self.desk.drop(paths)
        except Exception as error:  # glfw would keep it, and raise it in some later call
            self.session.report("Cannot take this file", error)

    def _closing(self) -> None:
        self.session.worker.close()
        if self.desk.autosave:
            self.desk.autosave.close()
        self._keep()
        assert self.desk.canvas and self.desk.images
        self.desk.canvas.release()
        self.desk.images.release()

    def _before_frame(self) -> None:
        try:
            self.session.tick()
            self.desk.follow_fit()
            if self.desk.autosave:
                self.desk.autosave.tick()
        except Exception as error:  # of one callback; the others go on in the next frame
            self.session.report("Something went wrong", error)
        likes = self.desk.likes
        if likes.dark != self._themed:
            self._themed = likes.dark
            theme.apply(self.desk.palette)
            self.params.imgui_window_params.background_color = imgui.ImVec4(*self.desk.palette.back, 1.0)
        imgui.get_style().font_scale_main = likes.text
        if not self._headless:
            self.params.fps_idling.fps_max = self._rate()
        self.each_frame()

    def _rate(self) -> float:
        io = imgui.get_io()
        if any(io.mouse_delta) or any(io.mouse_down) or io.mouse_wheel or imgui.is_any_item_active():
            self._touched = time.monotonic()
        if not (self._software and self.session.worker.busy()):
            return _RATE
        return _RATE_BESIDE_WORKER if time.monotonic() - self._touched < _TOUCHED else _RATE_OF_PROGRESS

    def _draw_menus(self) -> None:
        self._safely("The menu failed", lambda: menu.draw(self.desk))

    def _draw(self) -> None:
        self._safely("This key failed", lambda: menu.keys(self.desk))
        self._safely("The messages failed", lambda: messages.draw(self.desk))
        self._safely("The help failed", lambda: help.draw(self.desk))
        self._safely("The last session cannot be offered", lambda: recovery.draw(self.desk))
        self._safely("Cannot take this file", self.desk.files.draw)
        if self._safely("The photo cannot be cut out", lambda: self._cutting.draw(self.desk)):
            self.session.cutting.close()
        for title in filter(None, (self.desk.beside, self.desk.focus)):
            self.params.docking_params.focus_dockable_window(title)
        self.desk.beside = self.desk.focus = ""
        assert self.desk.images is not None
        self.desk.images.sweep()
        if self._folder and self.desk.likes != self._kept and not imgui.is_any_mouse_down():
            self._keep()

    def _keep(self) -> None:
        """Preferences are kept as soon as they change, so that a crash does not lose them."""
        if self._folder and self.desk.likes != self._kept:
            self._kept = self.desk.likes
            try:
                self._kept.save(self._folder)
            except (ValueError, OSError) as error:
                self.session.report("Cannot keep the preferences", error)

    def _reset_layout(self) -> None:
        self.params.docking_params.layout_reset = True


def _sparing_a_core() -> Iterator[None]:
    """Beside a window that the processor draws, threads that wait for each other are slower than one thread less."""
    torch.set_num_threads(max(1, torch.get_num_threads() - 1))
    yield None
