"""A preview of the file to share, and the time that saving will take."""

import time
from collections.abc import Iterator

from core.detail.progressive import RenderJob, RenderSettings
from core.export.dimensions import draw_dimensions
from core.export.films import View
from core.export.video_frames import FEW_PIXELS, FEW_SAMPLES, Image, over, rendered_pixels
from core.geometry.camera import Camera
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import WIDE, ShareSettings

_SIZE = 256  # px, width
_NAME = "share preview"  # job


class SharePreview:
    """Renders the file's first frame whenever its inputs change, except during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        self.image: Image | None = None  # on transparent; None until it is rendered
        self.seconds: float | None = None  # estimated time of saving the file; None if unknown
        self._inputs: tuple[object, ...] = ()  # of the current or next image

    def update(self, settings: ShareSettings) -> None:
        """Update the preview; call once a frame while it is visible."""
        scene = self._editor.scene
        partner = self._editor.film_partner
        looks = settings.kind, settings.wide, settings.size, settings.shows_shadow, settings.unit
        inputs = scene, partner, *looks
        if inputs == self._inputs or self._editor.history.gesture:
            return
        self._inputs = inputs
        self.seconds = None

        def stream() -> Iterator[tuple[Image, float | None] | None]:
            views = settings.views(scene, partner)
            work = {"page": FEW_PIXELS, "mesh": 0}.get(settings.kind, rendered_pixels(views))
            camera = views[0].camera.resized(_SIZE, round(_SIZE / WIDE) if settings.wide else _SIZE)
            few = RenderSettings(FEW_SAMPLES, divisors=(1,))
            seconds = 0.0  # of this job alone: others have their turns between its steps
            began = time.perf_counter()
            for frame in self._jobs.frames(RenderJob(views[0].instance, camera, few, shadow=settings.shows_shadow)):
                seconds += time.perf_counter() - began
                pace = seconds / (camera.width * camera.height)
                yield (with_dimensions(over(frame, None, camera), camera), work * pace or None) if frame else None
                began = time.perf_counter()

        def with_dimensions(image: Image, camera: Camera) -> Image:
            shows = settings.unit and settings.kind in ("page", "picture")
            return draw_dimensions(image, View(scene.instance, camera), settings.unit) if shows else image

        def rendered(preview: tuple[Image, float | None]) -> None:
            self.image, self.seconds = preview

        self._jobs.submit(Job(_NAME, stream, rendered, self._jobs.reporting("Cannot render the preview"), urgent=True))

    @property
    def stale(self) -> bool:
        """True while the image shows earlier settings."""
        return self._jobs.busy(_NAME)

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel(_NAME)
        self._inputs = ()
