"""A preview of the file to share, and the time that writing the file will take."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from core.export.keyframes import View
from core.export.pace import Pace
from core.export.video_frames import Image
from core.models.codes import Codes
from core.rendering.baked_field import BakedField
from viewer.editor import Editor
from viewer.services.jobs import TILES_SHARE, Jobs
from viewer.services.worker import Job
from viewer.values.share_settings import ShareSettings

_SIZE = 256  # px, height
_NAME, _PACE = "share preview", "share pace"  # jobs


class SharePreview:
    """Renders the file's first frame whenever its inputs change, except during a drag."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs, self._editor = jobs, editor
        self.image: Image | None = None  # on transparent; None until it is rendered
        self._shown: tuple[object, ...] = ()  # inputs of the current or next image
        self._copied: tuple[Codes, int] | None = None  # object and cells of the baked copy it shows
        self._paces = dict[str, Pace]()  # measured pace of videos on this machine, by the model's fingerprint
        self._known: tuple[tuple[object, ...], float] | None = None

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
        if self.pace is None and not self._jobs.busy(_PACE):
            self._measure(View(state.scene.codes, state.scene.camera))

    @property
    def pace(self) -> Pace | None:
        """Pace of videos of the shown object's model; None until it is measured."""
        return self._paces.get(self._editor.model.fingerprint)

    @property
    def stale(self) -> bool:
        """True while the image shows earlier settings."""
        return self._jobs.busy(_NAME)

    def seconds(self, settings: ShareSettings) -> float | None:
        """Return the seconds that a video or an image will take; None while unknown."""
        state = self._editor.state
        if self.pace is None or settings.kind == "mesh" or (settings.kind == "video" and not state.timeline.keys):
            return None
        about = self.pace, state.scene, state.timeline, settings
        if self._known is None or self._known[0] != about:
            views = settings.unframed_views(self._jobs.models, state.scene, state.timeline)
            self._known = about, self.pace.seconds(views, settings.suffix, settings.exact)
        return self._known[1]

    def _measure(self, view: View) -> None:
        """Measure the pace; ignore errors, which the preview reports too."""
        backend, model = self._jobs.backend, self._editor.model

        def measured(pace: Pace) -> None:
            self._paces[model.fingerprint] = pace

        self._jobs.submit(Job(_PACE, lambda: backend.pace(model, view), measured, share=TILES_SHARE))

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel(_NAME, _PACE)
        self._shown = ()
