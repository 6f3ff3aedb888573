"""A preview of the file to share."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from core.export.video_frames import Image
from core.models.codes import Codes
from core.rendering.baked_field import BakedField
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import ShareSettings

_SIZE = 256  # px, height
_NAME = "share preview"  # job


class SharePreview:
    """Renders the file's first frame whenever its inputs change, except during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs, self._editor = jobs, editor
        self.image: Image | None = None  # on transparent; None until it is rendered
        self._shown: tuple[object, ...] = ()  # inputs of the current or next image
        self._copied: tuple[Codes, int] | None = None  # object and cells of the baked copy it shows

    def update(self, settings: ShareSettings, baked_copy: Callable[[Codes], BakedField | None]) -> None:
        """Update the preview; call once a frame while it is visible. A video without keyframes has none.

        Args:
            baked_copy: returns an object's baked copy, if any: three times faster; a finer render replaces it.
        """
        if settings.kind == "video" and not self._editor.state.timeline.keys:
            return
        state, models = self._editor.state, self._jobs.models
        framing = settings.kind, settings.fill, settings.wide, settings.shows_shadow
        wanted = state.scene, state.timeline, framing
        finer = baked_copy(self._copied[0]) if self._copied else None
        is_coarse = self._copied is not None and finer is not None and finer.cells > self._copied[1]
        if (wanted == self._shown and not is_coarse) or self._editor.history.gesture:
            return
        self._copied = None
        self._shown, small, shadow = wanted, replace(settings, size=_SIZE), settings.shows_shadow

        def stream() -> Iterator[tuple[Image, tuple[Codes, int] | None] | None]:
            view = small.views(models, state.scene, state.timeline)[0]
            baked, backend = baked_copy(view.codes), self._jobs.backend
            drawn = backend.draw(baked, view.camera, shadow) if baked else None
            if baked and drawn is not None:
                yield drawn, (view.codes, baked.cells)
                return
            for image in backend.pictures(models, [view], None, False, shadow):
                yield None if image is None else (image, None)

        def rendered(found: tuple[Image, tuple[Codes, int] | None]) -> None:
            self.image, self._copied = found

        self._jobs.submit(Job(_NAME, stream, rendered, self._jobs.reporting("Cannot render the preview"), urgent=True))

    @property
    def stale(self) -> bool:
        """True while the image shows earlier settings."""
        return self._jobs.busy(_NAME)

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel(_NAME)
        self._shown = ()
