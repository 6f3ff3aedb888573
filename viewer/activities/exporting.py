"""The export of videos, images, meshes and scenes to files."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from core.export.dimensions import draw_dimensions
from core.export.films import View
from core.export.page import ROOM_SUFFIX, PageExtras
from core.models.model import Instance
from core.models.scene import Scene, save_image
from viewer.activities.film_previews import FilmPreviews
from viewer.activities.names import Names
from viewer.activities.share_preview import SharePreview
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.messages import MessageKind
from viewer.services.worker import Job
from viewer.values.share_settings import FILMS, ShareSettings

Variants = dict[str, Instance]  # versions of an object in one file, by name


class Exporting:
    """Exports one file at a time, to its end even if another project is begun meanwhile."""

    def __init__(self, jobs: Jobs, editor: Editor, names: Names) -> None:
        self._jobs = jobs
        self.begin(editor, names)
        self.path: Path | None = None  # the file being written
        self.kind = ""  # kind of the last file: one of :data:`~viewer.values.share_settings.KINDS`
        self.saved: Path | None = None  # the last written file
        self.progress = 0.0  # finished fraction of the current file, 0..1
        self._note = ""  # of the current file, for a person
        self._began = 0.0, 0.0  # time (s, monotonic clock) and finished fraction of the first progress

    def begin(self, editor: Editor, names: Names) -> None:
        """Export the objects of an editor from now on."""
        self._editor = editor
        self._names = names
        self.preview = SharePreview(self._jobs, editor)
        self.films = FilmPreviews(self._jobs, editor)

    @property
    def running(self) -> bool:
        """True while a file is being written."""
        return self.path is not None

    @property
    def remaining(self) -> float | None:
        """The remaining seconds at the rate since the first progress; None while unknown."""
        since, first = self._began
        if not self.running or self.progress <= first:
            return None
        return (time.monotonic() - since) * (1 - self.progress) / (self.progress - first)

    def share(self, path: Path, settings: ShareSettings) -> None:
        """Begin to write a page, film, image or mesh, in the format of the path's ending.

        Nothing happens while another file is written. A name without an ending is a folder of frames; a PNG also holds
        the scene.
        """
        several = settings.all_versions and settings.holds_versions
        variants = self._names.colour_versions() if several else {}
        if settings.kind == "mesh":
            self._begin("mesh", path, lambda scene: self._mesh(scene, path, settings, variants))
        elif settings.kind == "page":
            title = self._names.pair(self._editor.state.mix.a)
            self._begin("page", path, lambda scene: self._page(scene, path, settings, title, variants))
        elif settings.kind == "picture":
            self._begin("picture", path, lambda scene: self._picture(scene, path, settings))
        elif settings.kind in FILMS:
            partner = self._editor.film_partner
            self._begin(settings.kind, path, lambda scene: self._film(settings.views(scene, partner), path, settings))

    def cancel(self) -> None:
        """Cancel the export; no partial file stays."""
        if self.path:
            self._jobs.cancel("export")
            self._jobs.messages.notify(f"Cancelled: {self.path.name} was not written", MessageKind.NOTE)
            self.path = None

    def _mesh(self, scene: Scene, path: Path, settings: ShareSettings, variants: Variants) -> Iterator[float]:
        mesh_settings = settings.mesh_settings(scene.instance)
        writing = self._jobs.backend.mesh(scene.instance, path, mesh_settings, scene.photo_camera, variants)
        self._note = (yield from writing) or ""

    def _film(self, views: list[View], path: Path, settings: ShareSettings) -> Iterator[float]:
        for done in self._jobs.backend.video(views, path, settings.video_settings):
            yield done / len(views)

    def _page(
        self, scene: Scene, path: Path, settings: ShareSettings, title: str, variants: Variants
    ) -> Iterator[float]:
        (instance, camera), *_ = settings.views(scene)
        extras = PageExtras(variants, settings.unit, settings.room)
        for _ in self._jobs.backend.page(instance, camera, path, title, extras):
            yield 0.0
        if settings.room:
            self._note = f"{path.stem}{ROOM_SUFFIX} beside it is for Android phones"

    def _picture(self, scene: Scene, path: Path, settings: ShareSettings) -> Iterator[float]:
        view = settings.views(scene)[0]
        for image in self._jobs.backend.pictures([view], settings.behind, shadow=settings.shows_shadow):
            if image is not None:
                save_image(draw_dimensions(image, view, settings.unit) if settings.unit else image, path, scene)
            yield float(image is not None)

    def _begin(self, kind: str, path: Path, stream: Callable[[Scene], Iterator[float]]) -> None:
        """Run a stream that yields the finished fraction of the work, unless a file is being written."""
        if self.running:
            return
        self.kind = kind
        self.path = path
        self._note = ""
        self.progress = 0.0
        self._began = (0.0, 0.0)
        scene = self._editor.scene

        def changes() -> Iterator[float | None]:
            reported = 0.0
            for done in stream(scene):
                yield done if done != reported else None  # as a value redraws the window
                reported = done

        def advanced(done: float) -> None:
            if not self.progress:  # what came before was preparation, or another job's time
                self._began = time.monotonic(), done
            self.progress = done

        self._jobs.submit(Job("export", changes, advanced, self._ended))

    def _ended(self, error: Exception | None) -> None:
        path = self.path
        self.path = None
        if path and error:
            self._jobs.messages.report(f"Cannot export {path.name}", error)
        elif path:
            self.saved = path
            self._jobs.messages.notify(": ".join(filter(None, (f"Saved {path.name}", self._note))))
