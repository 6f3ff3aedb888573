"""The first frame of what is to be shared, small."""

from collections.abc import Iterator
from dataclasses import replace

from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import ShareSettings

_SIZE = 256
"""px"""
_SETTINGS = RenderSettings(samples=96, divisors=(1,))


class SharePreview:
    """Rendered again whenever it would look different, but not during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs, self._editor = jobs, editor
        self.frame: Frame | None = None
        """on white; None until it is rendered"""
        self._shown: tuple[object, ...] = ()
        """what it shows"""

    def update(self, settings: ShareSettings) -> None:
        """To be called once a frame while it is looked at. A video without keyframes has no first frame."""
        if settings.kind == "video" and not self._editor.state.timeline.keys:
            return
        state, model = self._editor.state, self._editor.model
        framing = settings.kind, settings.fill, settings.frames, settings.rate
        wanted = state.scene, state.timeline, framing
        if wanted == self._shown or self._editor.history.gesture:
            return
        self._shown, small = wanted, replace(settings, size=_SIZE)

        def stream() -> Iterator[Frame | None]:
            view = small.views(model, state.scene, state.timeline)[0]
            return self._jobs.backend.frames(model, RenderJob(view.codes, view.camera, _SETTINGS))

        def rendered(frame: Frame) -> None:
            self.frame = frame

        self._jobs.submit(Job("share preview", stream, rendered, self._jobs.reporting("Cannot render the preview")))

    def close(self) -> None:
        """Render no more."""
        self._jobs.cancel("share preview")
        self._shown = ()
