"""A preview of the file to share."""

from collections.abc import Iterator
from dataclasses import replace

from core.export.video_frames import FEW_SAMPLES, Image, over
from core.rendering.progressive import RenderJob, RenderSettings
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import WIDE, ShareSettings

_SIZE = 256  # px, width
_NAME = "share preview"  # job


class SharePreview:
    """Renders the file's first frame whenever its inputs change, except during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs, self._editor = jobs, editor
        self.image: Image | None = None  # on transparent; None until it is rendered
        self._shown: tuple[object, ...] = ()  # inputs of the current or next image

    def update(self, settings: ShareSettings) -> None:
        """Update the preview; call once a frame while it is visible. A video without keyframes has none."""
        scene, timeline, models = self._editor.scene, self._editor.playable, self._jobs.models
        wanted = scene, timeline, settings.kind, settings.fill, settings.wide, settings.shows_shadow
        unwanted = settings.kind == "video" and not timeline.keys
        if unwanted or wanted == self._shown or self._editor.history.gesture:
            return
        self._shown = wanted
        small = replace(settings, size=round(_SIZE / WIDE) if settings.wide else _SIZE)

        def stream() -> Iterator[Image | None]:
            view = small.views(models, scene, timeline)[0]
            job = RenderJob(*view, RenderSettings(FEW_SAMPLES, divisors=(1,)), shadow=small.shows_shadow)
            for frame in self._jobs.frames(job):
                yield over(frame, None, view.camera) if frame else None

        def rendered(image: Image) -> None:
            self.image = image

        self._jobs.submit(Job(_NAME, stream, rendered, self._jobs.reporting("Cannot render the preview"), urgent=True))

    @property
    def stale(self) -> bool:
        """True while the image shows earlier settings."""
        return self._jobs.busy(_NAME)

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel(_NAME)
        self._shown = ()
