"""Turntables and pictures on their way into files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from core.camera import Camera
from core.codes import Codes
from core.frames import Frame, RenderJob, RenderSettings
from core.model import Model
from viewer.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session


def turntable(
    model: Model, codes: Codes, camera: Camera, path: Path, frames: int = 72, size: int = 256
) -> Iterator[int]:
    """core.video.turntable; imported on the worker, as the video library takes its time."""
    from core.video import turntable as stream

    return stream(model, codes, camera, path, frames, size)


class Exporting:
    """At most one turntable and one picture at a time."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.path: Path | None = None
        """the turntable under way"""
        self.done = 0
        self.total = 1

    @property
    def running(self) -> bool:
        """A turntable is under way."""
        return self.path is not None

    def turntable(self, path: Path, frames: int = 72, size: int = 256) -> None:
        """Write the object turning once round as mp4, gif or webp, by the file's name."""
        if self.running or self._session.model is None:
            return
        self.path, self.done, self.total = path, 0, frames
        model, scene, stream = self._session.model, self._session.scene, self._session.streams.turntable
        self._session.worker.submit(
            Job(
                "turntable",
                lambda: stream(model, scene.codes, scene.camera, path, frames, size),
                self._advanced,
                self._ended,
            )
        )

    def cancel(self) -> None:
        """Give the turntable up; no half-written file stays."""
        if self.path:
            self._session.worker.cancel("turntable")
            self._session.say(f"Cancelled: {self.path.name} was not written")
            self.path = None

    def picture(self, path: Path, size: int = 512) -> None:
        """Write the scene as a square picture on white."""
        if self._session.model is None:
            return
        path = path if path.suffix else path.with_suffix(".png")
        model, scene = self._session.model, self._session.scene
        job = RenderJob(scene.codes, scene.camera.resized(size, size), RenderSettings(stages=(1,)))

        def ended(error: Exception | None) -> None:
            if error:
                self._session.report("Cannot save the picture", error)
            else:
                self._session.say(f"Saved {path.name}")

        stream = self._session.streams.frames(model, job)
        self._session.worker.submit(Job("picture", lambda: _written(stream, path), lambda _: None, ended))

    def _advanced(self, done: int) -> None:
        self.done = done

    def _ended(self, error: Exception | None) -> None:
        path, self.path = self.path, None
        if error:
            self._session.report("Cannot export the turntable", error)
        elif path:
            self._session.say(f"Saved {path.name}")


def _written(stream: Iterator[Frame | None], path: Path) -> Iterator[None]:
    for frame in stream:
        if frame:
            _save(frame, path)
        yield None


def _save(frame: Frame, path: Path) -> None:
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    try:
        Image.fromarray(frame.image).save(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
