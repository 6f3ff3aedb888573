"""A fit under way: the photo, its steps so far, and what the fitted object looks like."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image

from core.camera import Camera
from core.fit import FitJob, FitStep
from core.frames import Frame, RenderJob, RenderSettings
from core.model import Model
from core.photos import Photo
from viewer.gallery import Thing
from viewer.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session

_LOOK_EVERY = 0.3
"""s between two pictures of the fit, which take their time from it"""
_LIVE = RenderSettings(samples=48, stages=(2,))
_FINISHED = RenderSettings(stages=(1,))


@dataclass(frozen=True, eq=False)
class Course:
    """How a fit has gone so far."""

    name: str = ""
    photo: Photo | None = None
    pixels: np.ndarray | None = None
    """the photo as uint8"""
    steps: tuple[FitStep, ...] = ()
    picture: Frame | None = None
    """the newest picture of the leading hypothesis, from the photo's camera"""
    difference: np.ndarray | None = None
    """between the photo and that picture, doubled; uint8, black where they agree"""

    @property
    def shown(self) -> np.ndarray | None:
        """That picture on white, as the photo is."""
        return self.picture.image if self.picture else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def progress(self) -> float:
        """0..1"""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0


class Fitting:
    """At most one fit at a time. Its result joins the objects and becomes current, a single edit."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.reset()

    def reset(self) -> None:
        """Forget the fit; one under way is dropped."""
        self._session.worker.cancel("fit")
        self._session.worker.cancel("fit picture")
        self.course = Course()
        """of the fit under way, or of the last one"""
        self.running = False
        self._looked = 0.0

    def start(self, path: Path) -> None:
        """Fit the object in an image. An image that cannot be used leaves everything as it was."""
        model = self._session.model
        if model is None:
            self._session.when_ready = lambda: self.start(path)
            return
        if self.running:
            self._session.say("A fit is under way: stop it first")
            return
        before = self.course
        self.reset()
        self.course, self.running = Course(path.stem), True

        def ended(error: Exception | None) -> None:
            if error and not self.course.steps:
                self.course = before
            self._ended(error)

        self._session.worker.submit(Job("fit", lambda: self._stream(model, path), self._value, ended))

    def stop(self) -> None:
        """End the fit here and keep what it has found."""
        if self.running:
            self._session.worker.cancel("fit")
            self._finish("Stopped")

    @property
    def camera(self) -> Camera:
        """The photo's camera, at the size of the model's pictures. Only once there are steps."""
        assert self.course.last is not None, "no fit yet"
        return self._resized(self.course.last.cameras[0])

    @property
    def alternative(self) -> Camera | None:
        """The next best camera, mostly from the object's other side, at the same size; None where none was found."""
        other = self.course.last and self.course.last.alternative
        return self._resized(other.cameras[0]) if other else None

    def _resized(self, camera: Camera) -> Camera:
        model = self._session.model
        assert model is not None, "no model yet"
        return camera.resized(model.image_size, model.image_size)

    def _stream(self, model: Model, path: Path) -> Iterator[Photo | FitStep]:
        photo = self._session.streams.load_photo(path, model)
        yield photo
        yield from self._session.streams.fit(model, FitJob((photo,)))

    def _value(self, value: Photo | FitStep) -> None:
        if isinstance(value, Photo):
            pixels = (value.pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()
            self.course = replace(self.course, photo=value, pixels=pixels)
            return
        self.course = replace(self.course, steps=(*self.course.steps, value))
        if time.monotonic() - self._looked > _LOOK_EVERY and not self._session.worker.busy("fit picture"):
            self._look(_LIVE)

    def _look(self, settings: RenderSettings) -> None:
        self._looked = time.monotonic()
        model, step = self._session.model, self.course.steps[-1]
        assert model is not None
        job = RenderJob(step.codes, step.cameras[0], settings)

        def failed(error: Exception | None) -> None:
            if error:
                self._session.report("Cannot draw the fit", error)

        stream = self._session.streams.frames
        self._session.worker.submit(Job("fit picture", lambda: stream(model, job), self._pictured, failed))

    def _pictured(self, frame: Frame) -> None:
        assert self.course.pixels is not None, "a photo comes before its fit"
        difference = _doubled_difference(self.course.pixels, frame.image)
        self.course = replace(self.course, picture=frame, difference=difference)

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Fitted")
            return
        self.running = False
        self._session.report("Cannot fit this image", error)

    def _finish(self, how: str) -> None:
        self.running = False
        name, last = self.course.name, self.course.last
        if last is None:
            self._session.say(f"{how} before there was a result")
            return
        self._look(_FINISHED)
        self._session.adopt(Thing(name, last.codes, self.course.photo), self.camera)
        self._session.say(f"{how} in {last.seconds:.0f} s: {name}, {last.psnr:.1f} dB")


def _doubled_difference(
    photo: UInt8[np.ndarray, "height width 3"], render: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Both at the photo's size; a render that is a preview is smaller."""
    enlarged = np.asarray(Image.fromarray(render).resize(photo.shape[1::-1]), np.int16)
    return (2 * np.abs(photo - enlarged)).clip(0, 255).astype(np.uint8)
