"""Videos, meshes, grids, images and scenes on their way into files."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

from core.export.keyframes import View, turntable
from core.export.video import VideoSettings
from core.models.model import Model
from core.models.scene import Scene, save_image
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.grid import Grid, write_grid
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit

Kind = Literal["turntable", "timeline", "mesh", "grid"]


class Exporting:
    """At most one video, mesh or grid, and one image, at a time."""

    def __init__(self, jobs: Jobs, editor: Editor, grid: Grid) -> None:
        self._jobs, self._editor, self._grid = jobs, editor, grid
        self.path: Path | None = None
        """the video, mesh or grid under way"""
        self.kind: Kind | None = None
        """which of them it is, or was last: .webp is both a video and an image"""
        self.progress = 0.0
        """of it, 0..1"""
        self._began = 0.0
        """s on the monotonic clock"""

    @property
    def running(self) -> bool:
        """A video, a mesh or a grid is under way."""
        return self.path is not None

    @property
    def remaining(self) -> float | None:
        """s that it will take still at this rate; None until that is known."""
        if not self.running or self.progress <= 0:
            return None
        return (time.monotonic() - self._began) * (1 / self.progress - 1)

    def turntable(self, path: Path, frames: int = 72, options: VideoSettings | None = None) -> None:
        """Write the object turning once round as mp4, gif, webp or a folder of images, by the name's ending."""
        self._video("turntable", path, lambda scene: turntable(scene.codes, scene.camera, frames), frames, options)

    def timeline(self, path: Path, options: VideoSettings | None = None) -> None:
        """Write the timeline as mp4, gif, webp or a folder of images, by the name's ending."""
        timeline, rate = self._editor.state.timeline, (options or VideoSettings()).rate
        if timeline.keys:
            self._video("timeline", path, lambda _: timeline.views(rate), timeline.frame_count(rate), options)

    def mesh(self, path: Path, resolution: int | None = None) -> None:
        """Write the object as a coloured mesh, glb, ply or obj by the file's name.

        Args:
            resolution: cells along the longest side of the model's box; None: as many as the object's detail needs.
        """
        self._begin("mesh", path, lambda model, scene: self._jobs.backend.mesh(model, scene.codes, path, resolution))

    def grid(self, path: Path, size: int = 256) -> None:
        """Write the grid as one image on white, a cell so many px wide and high."""
        rows = [[self._editor.pair(pair) for pair in row] for row in self._grid.rows]

        def stream(model: Model, scene: Scene) -> Iterator[float]:
            camera = orbit.home(model).resized(size, size)
            return write_grid(lambda job: self._jobs.backend.frames(model, job), rows, camera, path)

        if rows:
            self._begin("grid", path, stream)

    def cancel(self) -> None:
        """Give the file under way up; no half-written file stays."""
        if self.path:
            self._jobs.cancel("export")
            self._jobs.notify(f"Cancelled: {self.path.name} was not written")
            self.path = None

    def image(self, path: Path, size: int = 512) -> None:
        """Write the scene as a square image on white; a PNG holds the scene as well."""
        scene = self._editor.scene
        job = RenderJob(scene.codes, scene.camera.resized(size, size), RenderSettings(divisors=(1,)))

        def ended(error: Exception | None) -> None:
            if error:
                self._jobs.report("Cannot save the image", error)
            else:
                self._jobs.notify(f"Saved {path.name}")

        stream = self._jobs.backend.frames(self._editor.model, job)
        self._jobs.submit(Job(f"image {path}", lambda: _write_image(stream, path, scene), lambda _: None, ended))

    def scene(self, path: Path, scene: Scene | None = None) -> None:
        """Write a scene, or what is shown, as JSON, at once."""
        try:
            (scene or self._editor.scene).save(path)
        except ValueError as error:
            self._jobs.report("Cannot save the scene", error)
        else:
            self._jobs.notify(f"Saved {path.name}")

    def _video(
        self,
        kind: Kind,
        path: Path,
        views: Callable[[Scene], list[View]],
        count: int,
        options: VideoSettings | None,
    ) -> None:
        write, chosen = self._jobs.backend.video, options or VideoSettings()
        self._begin(kind, path, lambda model, scene: write(model, views(scene), path, chosen), count)

    def _begin(
        self, kind: Kind, path: Path, stream: Callable[[Model, Scene], Iterator[float]], total: float = 1.0
    ) -> None:
        """Run a stream that yields how much it has done, of so much in all."""
        if self.running:
            return
        self.kind, self.path, self.progress, self._began = kind, path, 0.0, time.monotonic()
        model, scene = self._editor.model, self._editor.scene

        def advanced(done: float) -> None:
            self.progress = done / total

        self._jobs.submit(Job("export", lambda: stream(model, scene), advanced, self._ended))

    def _ended(self, error: Exception | None) -> None:
        path, self.path = self.path, None
        if path and error:
            self._jobs.report(f"Cannot export {path.name}", error)
        elif path:
            self._jobs.notify(f"Saved {path.name}")


def _write_image(stream: Iterator[Frame | None], path: Path, scene: Scene) -> Iterator[None]:
    for frame in stream:
        if frame:
            save_image(frame.image, path, scene)
        yield None
