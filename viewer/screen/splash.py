"""The splash window, shown at once while slow imports run in the background.

Imports no torch itself.
"""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from imgui_bundle import ImVec2, ImVec4, hello_imgui, imgui

from viewer.screen import theme, window

T = TypeVar("T")

_SIZE = 420, 150  # px of a 96 ppi screen
_FIRST_FRAMES = 3  # frames until the window is on screen, when the work begins
_RATE = 20.0  # frames per second, low to leave the processor to imports


class Splash(Generic[T]):
    """A window that runs a function in another thread and shows its error, if any."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._result: list[T] = []
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="start")
        self.params = hello_imgui.RunnerParams()
        geometry = self.params.app_window_params
        geometry.window_title = window.NAME
        geometry.window_geometry.size = _SIZE
        geometry.borderless = True
        self.params.ini_disable = True
        self.params.renderer_backend_options.open_gl_options = hello_imgui.OpenGlOptions(anti_aliasing_samples=0)
        self.params.fps_idling.fps_max = self.params.fps_idling.fps_idle = _RATE
        self.params.imgui_window_params.background_color = ImVec4(*theme.DARK.back, 1.0)
        self.params.callbacks.setup_imgui_style = lambda: theme.apply(theme.DARK)
        self.params.callbacks.show_gui = self._draw

    def run(self) -> T:
        """Return the function's value or raise its error; ``SystemExit`` if the window is closed before."""
        window.run(self.params)
        if self._error:
            raise self._error
        if not self._result:
            raise SystemExit(0)
        return self._result[0]

    def _run(self) -> None:
        try:
            self._result.append(self._work())
        except BaseException as error:  # shown, and raised by :meth:`run`
            self._error = error

    def _draw(self) -> None:
        # The work begins once an image is on screen: before, its imports would delay the window.
        if imgui.get_frame_count() == _FIRST_FRAMES:
            self._thread.start()
        if self._result:
            self.params.app_shall_exit = True
        imgui.push_font(None, theme.SIZE * 1.6)
        imgui.text(window.NAME)
        imgui.pop_font()
        if self._error:
            imgui.text_wrapped(f"It cannot start: {self._error}")
            if imgui.button("Close"):
                self.params.app_shall_exit = True
        else:
            imgui.text_disabled("Loading …")
            imgui.progress_bar(-float(imgui.get_time()), ImVec2(-1.0, 4.0), "")
