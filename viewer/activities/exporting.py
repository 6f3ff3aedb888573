"""Films, meshes, sheets and pictures on their way into files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from core.export.keyframes import Shot, turntable
from core.models.codes import Codes
from core.models.model import Model
from core.models.pictures import save_picture
from core.models.scene import Scene
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.grid import write_sheet
from viewer.services.worker import Job
from viewer.values import orbit

if TYPE_CHECKING:
    from viewer.session import Session

Kind = Literal["turntable", "film", "mesh", "sheet"]


@dataclass(frozen=True)
class VideoChoice:
    """What core.export.video.VideoSettings holds; the video library is imported on the worker, as it takes its time."""

    size: int = 256
    rate: int = 24
    quality: int = 85
    transparent: bool = False


def film(model: Model, shots: Sequence[Shot], path: Path, choice: VideoChoice) -> Iterator[int]:
    """core.export.video.film."""
    from core.export.video import VideoSettings
    from core.export.video import film as stream

    return stream(model, shots, path, VideoSettings(**asdict(choice)))


def mesh(model: Model, codes: Codes, path: Path, resolution: int | None = None) -> Iterator[float]:
    """core.export.mesh.export_mesh; imported on the worker, as the mesh libraries take their time."""
    from core.export.mesh import export_mesh

    return export_mesh(model, codes, path, resolution)


class Exporting:
    """At most one film, mesh or sheet, and one picture, at a time."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.path: Path | None = None
        """the film, mesh or sheet under way"""
        self.kind: Kind | None = None
        """which of them it is, or was last: endings do not tell, as .webp is both a video and a picture"""
        self.progress = 0.0
        """of it, 0..1"""
        self._began = 0.0
        """s on the monotonic clock"""

    @property
    def running(self) -> bool:
        """A film, a mesh or a sheet is under way."""
        return self.path is not None

    @property
    def remaining(self) -> float | None:
        """s that it will take still if it goes on as so far; None until that can be told."""
        if not self.running or self.progress <= 0:
            return None
        return (time.monotonic() - self._began) * (1 / self.progress - 1)

    def turntable(self, path: Path, frames: int = 72, choice: VideoChoice | None = None) -> None:
        """Write the object turning once round as mp4, gif, webp or a folder of pictures, by the name's ending."""
        self._film("turntable", path, lambda scene: turntable(scene.codes, scene.camera, frames), frames, choice)

    def film(self, path: Path, choice: VideoChoice | None = None) -> None:
        """Write the timeline as mp4, gif, webp or a folder of pictures, by the name's ending."""
        if self._session.model is None or not self._session.state.timeline.keys:
            return
        timeline, rate = self._session.state.timeline, (choice or VideoChoice()).rate
        self._film("film", path, lambda _: timeline.shots(rate), timeline.count(rate), choice)

    def mesh(self, path: Path, resolution: int | None = None) -> None:
        """Write the object as a coloured mesh, glb, ply or obj by the file's name.

        Args:
            resolution: cells along the longest side of the model's box; None: as many as the object's detail asks for.
        """
        self._begin(
            "mesh",
            path,
            lambda model, scene: self._session.streams.mesh(model, scene.codes, path, resolution),
        )

    def sheet(self, path: Path, size: int = 256) -> None:
        """Write the cross sheet as one picture on white, a cell so many px wide and high."""
        session = self._session
        rows = [[session.pair(pair) for pair in row] for row in session.sheet.rows]

        def stream(model: Model, scene: Scene) -> Iterator[float]:
            camera = orbit.home(model).resized(size, size)
            return write_sheet(lambda job: session.streams.frames(model, job), rows, camera, path)

        if rows:
            self._begin("sheet", path, stream)

    def cancel(self) -> None:
        """Give the file under way up; no half-written file stays."""
        if self.path:
            self._session.worker.cancel("export")
            self._session.say(f"Cancelled: {self.path.name} was not written")
            self.path = None

    def picture(self, path: Path, size: int = 512) -> None:
        """Write the scene as a square picture on white; a PNG holds the scene as well."""
        if self._session.model is None:
            return
        model, scene = self._session.model, self._session.scene
        job = RenderJob(scene.codes, scene.camera.resized(size, size), RenderSettings(stages=(1,)))

        def ended(error: Exception | None) -> None:
            if error:
                self._session.report("Cannot save the picture", error)
            else:
                self._session.say(f"Saved {path.name}")

        stream = self._session.streams.frames(model, job)
        self._session.worker.submit(
            Job(f"picture {path}", lambda: _written(stream, path, scene), lambda _: None, ended)
        )

    def _film(
        self,
        kind: Kind,
        path: Path,
        shots: Callable[[Scene], list[Shot]],
        count: int,
        choice: VideoChoice | None,
    ) -> None:
        write, chosen = self._session.streams.film, choice or VideoChoice()
        self._begin(kind, path, lambda model, scene: write(model, shots(scene), path, chosen), count)

    def _begin(
        self, kind: Kind, path: Path, stream: Callable[[Model, Scene], Iterator[float]], total: float = 1.0
    ) -> None:
        """Draw from a stream that tells how much it has done, of so much in all."""
        model = self._session.model
        if self.running or model is None:
            return
        self.kind, self.path, self.progress, self._began = kind, path, 0.0, time.monotonic()
        scene = self._session.scene

        def advanced(done: float) -> None:
            self.progress = done / total

        self._session.worker.submit(Job("export", lambda: stream(model, scene), advanced, self._ended))

    def _ended(self, error: Exception | None) -> None:
        path, self.path = self.path, None
        if path and error:
            self._session.report(f"Cannot export {path.name}", error)
        elif path:
            self._session.say(f"Saved {path.name}")


def _written(stream: Iterator[Frame | None], path: Path, scene: Scene) -> Iterator[None]:
    for frame in stream:
        if frame:
            save_picture(frame.image, path, scene)
        yield None
