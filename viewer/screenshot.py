"""An image of the window, saved once everything is rendered."""

import time
from pathlib import Path

from imgui_bundle import hello_imgui
from PIL import Image

from viewer.app import App

_RATE = 12.0  # frames per second, low because the worker needs the processor
_SETTLED = 5  # idle frames after which the layout is stable
_FOR_THUMBNAILS = 20.0  # s to wait for thumbnails and other small jobs, of which there may be hundreds


def save_screenshot(app: App, path: Path, longest: float) -> None:
    """Run a window until all work is done, at most ``longest`` seconds, then end it and write its image."""
    jobs = app.session.jobs
    until = time.monotonic() + longest
    last_busy = 0.0  # s on the monotonic clock of the last frame with a running render or fit
    still = 0  # frames since

    def check() -> None:
        nonlocal last_busy, still
        if jobs.busy("view", "fit"):
            last_busy = time.monotonic()
            still = 0
        elif not jobs.busy() or time.monotonic() - last_busy > _FOR_THUMBNAILS:
            still += 1
        if still > _SETTLED or time.monotonic() > until:
            app.context.quit()

    app.each_frame = check
    app.params.fps_idling.fps_max = _RATE
    app.run()
    Image.fromarray(hello_imgui.final_app_window_screenshot()[..., :3]).save(path)
