"""An image of the window, taken by the program itself once everything is rendered."""

import time
from pathlib import Path

from imgui_bundle import hello_imgui
from PIL import Image

from viewer.app import App

_RATE = 12.0  # Frames per second: the processor is the worker's
_SETTLED = 5  # Frames after which the layout is stable
_FOR_THUMBNAILS = 20.0  # s that are waited for thumbnails, of which a model may have hundreds


class Screenshot:
    """Lets a window run until nothing is under way, then ends it and saves what it showed."""

    def __init__(self, app: App, longest: float) -> None:
        """Wait ``longest`` seconds at the most."""
        self._app = app
        self._until = time.monotonic() + longest
        self._busy = 0.0  # s on the monotonic clock, when the last large frame was finished
        self._still = 0
        app.each_frame = self._check
        app.params.fps_idling.fps_max = _RATE

    def save(self, path: Path) -> None:
        """Run the window, and write the image."""
        self._app.run()
        Image.fromarray(hello_imgui.final_app_window_screenshot()[..., :3]).save(path)

    def _check(self) -> None:
        session, now = self._app.session, time.monotonic()
        if session.jobs.busy("view", "fit"):
            self._busy, self._still = now, 0
        elif not session.jobs.busy() or now - self._busy > _FOR_THUMBNAILS:
            self._still += 1
        if self._still > _SETTLED or now > self._until:
            self._app.context.quit()
