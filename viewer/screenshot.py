"""An image of the window, saved once everything is rendered."""

import time
from pathlib import Path

from imgui_bundle import hello_imgui
from PIL import Image

from viewer.app import App

_RATE = 12.0  # frames per second, low because the worker needs the processor
_SETTLED = 5  # idle frames after which the layout is stable
_FOR_THUMBNAILS = 20.0  # s to wait for thumbnails and other small jobs, of which there may be hundreds


class Screenshot:
    """Runs a window until all work is done, then ends it and saves its image."""

    def __init__(self, app: App, longest: float) -> None:
        """Prepare to end ``app`` after ``longest`` seconds at most."""
        self._app = app
        self._until = time.monotonic() + longest
        self._busy = 0.0  # s on the monotonic clock of the last frame with a running render or fit
        self._still = 0  # frames since
        app.each_frame = self._check
        app.params.fps_idling.fps_max = _RATE

    def save(self, path: Path) -> None:
        """Run the window to its end and write its image."""
        self._app.run()
        Image.fromarray(hello_imgui.final_app_window_screenshot()[..., :3]).save(path)

    def _check(self) -> None:
        session = self._app.session
        now = time.monotonic()
        if session.jobs.busy("view", "fit"):
            self._busy = now
            self._still = 0
        elif not session.jobs.busy() or now - self._busy > _FOR_THUMBNAILS:
            self._still += 1
        if self._still > _SETTLED or now > self._until:
            self._app.context.quit()
