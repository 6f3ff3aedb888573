"""A preview of the file to share, and the time that saving will take."""

import time
from collections.abc import Hashable, Iterator

from core.detail.progressive import RenderJob, RenderSettings
from core.export.dimensions import draw_dimensions
from core.export.films import View
from core.export.video_frames import FEW_PIXELS, FEW_SAMPLES, Image, over, rendered_pixels
from core.geometry.camera import Camera
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.latest import Latest
from viewer.values.share_settings import WIDE, ShareSettings

_SIZE = 256  # px, width
_NAME = "share preview"  # job
_Preview = tuple[Image, float | None]  # on transparent; and estimated time of saving the file, s, if known


class SharePreview:
    """Renders the file's first frame whenever its inputs change, except during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        problem = "Cannot render the preview"
        self._preview = Latest[tuple[Hashable, ...], _Preview](jobs, _NAME, problem, urgent=True)

    @property
    def image(self) -> Image | None:
        """The newest image, on transparent; None until one is rendered."""
        return self._preview.value[0] if self._preview.value else None

    @property
    def seconds(self) -> float | None:
        """The estimated time of saving the file; None if unknown."""
        return self._preview.current and self._preview.current[1]

    def update(self, settings: ShareSettings) -> None:
        """Update the preview; call once a frame while it is visible."""
        scene = self._editor.scene
        partner = self._editor.film_partner

        def stream() -> Iterator[_Preview | None]:
            views = settings.views(scene, partner)
            work = {"page": FEW_PIXELS, "mesh": 0}.get(settings.kind, rendered_pixels(views))
            camera = views[0].camera.resized(_SIZE, round(_SIZE / WIDE) if settings.wide else _SIZE)
            few = RenderSettings(FEW_SAMPLES, divisors=(1,))
            job = RenderJob(views[0].instance, camera, few, shadow=settings.shows_shadow)
            seconds = 0.0  # of this job alone: others have their turns between its steps
            began = time.perf_counter()
            for frame in self._jobs.backend.frames(job):
                seconds += time.perf_counter() - began
                pace = seconds / (camera.width * camera.height)
                yield (with_dimensions(over(frame, None, camera), camera), work * pace or None) if frame else None
                began = time.perf_counter()

        def with_dimensions(image: Image, camera: Camera) -> Image:
            shows = settings.unit and settings.kind in ("page", "picture")
            return draw_dimensions(image, View(scene.instance, camera), settings.unit) if shows else image

        looks = settings.kind, settings.wide, settings.size, settings.shows_shadow, settings.unit
        self._preview.of((scene, partner, *looks), stream, asks=not self._editor.history.gesture)

    @property
    def stale(self) -> bool:
        """True while the image shows earlier settings."""
        return self._jobs.busy(_NAME)

    def close(self) -> None:
        """Stop rendering."""
        self._preview.close()
