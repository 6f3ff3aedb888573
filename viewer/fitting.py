"""A fit under way: its photos, its steps so far, and what the fitted object looks like."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.fitting.fit import PRESETS, FitJob, FitStep, Hypothesis
from core.geometry.camera import Camera
from core.models.scene import Scene
from core.photos.plain_background import NoBackgroundError
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer import orbit
from viewer.course import Course, Shot, Source, paired
from viewer.gallery import Thing
from viewer.race import Race
from viewer.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session

EFFORTS = ("draft", "normal", "fine")
"""Presets to choose from."""
_GOING_ON = 3
"""Where a fit goes on, it has one of so many steps of the preset: there is no race."""
_LOOK_EVERY = 0.3
"""s between two pictures of the fit, which take their time from it"""
_LOOK_STEPS = 4
"""steps between two pictures at the least, for machines on which they are slow"""
_LIVE = RenderSettings(samples=48, divisors=(2,))
_FINISHED = RenderSettings(divisors=(1,))


class Fitting:
    """At most one fit at a time. Its result joins the objects and becomes current, a single edit."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.race = Race(session)
        self.effort = "normal"
        """the preset of the next fit"""
        self.lens = False
        """whether that searches for the focal length too"""
        self.reset()

    def reset(self) -> None:
        """Forget the fit; one under way is dropped."""
        self._session.worker.cancel("fit")
        self._session.worker.cancel("fit picture")
        self.race.reset()
        self.course = Course()
        """of the fit under way, or of the last one"""
        self.running = False
        self._untouched: Scene | None = None
        self.live: Frame | None = None
        """the newest picture of the fit that was shown in the view"""
        self._looked, self._unseen = 0.0, 0

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit the object in images; pose files (.txt) among them belong to the images of their names."""
        try:
            self.fit(*paired(paths))
        except ValueError as error:
            self._session.report("Cannot fit this", error)

    def fit(self, *sources: Source) -> None:
        """Fit the object in photos. What cannot be used leaves everything as it was."""
        if sources and not self._session.when_ready(lambda: self.fit(*sources)):
            self._begin(Course(sources))

    def cut_out(self) -> None:
        """Point out the object in the photo that is looked at, and fit once more."""
        self._session.cutting.open(self.course.sources, self.course.view)

    def add(self, course: Course, path: Path) -> None:
        """Fit once more, with another photo of the object of a course."""
        self._begin(Course((*course.sources, Source(path))))

    def pose(self, course: Course, path: Path) -> None:
        """Fit once more, with the known camera of the photo that was looked at in a course."""
        sources = list(course.sources)
        sources[course.view] = sources[course.view]._replace(pose=path)
        self._begin(Course(tuple(sources), view=course.view))

    def again(self) -> None:
        """Fit the same photos once more, from the beginning."""
        self._run(Course(self.course.sources, self.course.shots, view=self.course.view))

    def go_on(self, begin: Hypothesis | None = None) -> None:
        """Go on from a hypothesis, or from the step that is looked at; the steps after that are forgotten."""
        begin = begin or self.going_on
        if begin is None:
            return
        kept = len(self.course.steps) if self.course.at is None else self.course.at + 1
        self._run(replace(self.course, steps=self.course.steps[:kept], at=None), begin)

    def go_on_from_view(self) -> None:
        """Go on from what is on screen: its codes, and for the photo that is looked at its camera."""
        if begin := self.going_on:
            scene, cameras = self._session.scene, list(begin.cameras)
            was = cameras[self.course.view]
            cameras[self.course.view] = scene.camera.resized(was.width, was.height)
            self.go_on(replace(begin, cameras=tuple(cameras), codes=scene.codes))

    @property
    def going_on(self) -> Hypothesis | None:
        """From where the step that is looked at can go on; None where it cannot yet."""
        step = self.course.step
        leader = step.race[0] if step and step.race else None
        return leader if leader and self.can_prefer(leader) else None

    def can_prefer(self, hypothesis: Hypothesis) -> bool:
        """Whether a fit of all photos can go on from it; one that is of some of them only cannot be gone on from."""
        return len(hypothesis.cameras) == len(self.course.shots)

    def stop(self) -> None:
        """End the fit here and keep what it has found."""
        if self.running:
            self._session.worker.cancel("fit")
            self._finish("Stopped")

    # What is looked at

    @property
    def followed(self) -> bool:
        """The view shows the fit on its way: nobody has changed the scene since it began."""
        session = self._session
        return self.running and session.ready and session.scene == self._untouched and not session.film.playing

    @property
    def camera(self) -> Camera:
        """The photo's camera in the step looked at, at the size of the model's pictures. Only once there are steps."""
        assert self.course.step is not None, "no fit yet"
        return self._resized(self.course.step.cameras[self.course.view])

    @property
    def alternative(self) -> Camera | None:
        """The next best camera, mostly from the object's other side, at the same size; None where none was found."""
        other = self.course.step and self.course.step.alternative
        return self._resized(other.cameras[self.course.view]) if other else None

    def scrub(self, index: int | None, gesture: str = "") -> None:
        """Look at a step: its codes, seen from its camera, are an edit of the scene. None is the newest step."""
        if not self.course.steps:
            return
        last = len(self.course.steps) - 1
        self.course = replace(self.course, at=None if index is None else max(0, min(index, last)))
        if step := self.course.step:
            self._session.visit(step.codes, self.camera, gesture)
            self._look(_LIVE)

    def turn_to(self, view: int) -> None:
        """Look at another photo."""
        if 0 <= view < len(self.course.shots):
            self.course = replace(self.course, view=view, picture=None, difference=None)
            if self.course.step:
                self._look(_LIVE)

    def keep(self) -> None:
        """Take the step that is looked at among the objects."""
        if step := self.course.step:
            name = f"{self.course.name} at {step.seconds:.1f} s"
            self._session.adopt(Thing(name, step.codes, self.course.shots[0].photo), self.camera)

    # On the way

    def _resized(self, camera: Camera) -> Camera:
        model = self._session.model
        assert model is not None, "no model yet"
        return camera.resized(model.image_size, model.image_size)

    def _begin(self, course: Course) -> None:
        if self.running:
            self._session.say("A fit is under way: stop it first")
        else:
            self._run(course)

    def _run(self, course: Course, begin: Hypothesis | None = None) -> None:
        model, before, race = self._session.model, self.course, self.race.tiles
        assert model is not None, "no model yet"
        self.reset()
        self.course, self.running = course, True
        self.race.reset(race if begin else ())
        self._untouched = self._session.scene
        settings = replace(PRESETS[self.effort], lens=self.lens)
        if begin:
            settings = replace(settings, steps=max(1, settings.steps // _GOING_ON))

        def ended(error: Exception | None) -> None:
            read = len(self.course.shots)
            if error and len(self.course.steps) == len(course.steps):
                self.course = before
                self.race.reset(race)
            self._ended(error)
            if isinstance(error, NoBackgroundError):
                self._session.cutting.open(course.sources, read)

        def stream() -> Iterator[Shot | FitStep | None]:
            if begin is None:
                with suppress(ValueError):  # where there is no bank, what needs one says why
                    yield from self._session.streams.preparing(model)
            photos = [shot.photo for shot in course.shots]
            for source in course.sources[len(photos) :]:
                photos.append(self._session.streams.load_photo(source.path, model, *source[1:]))
                yield Shot.of(source, photos[-1])
            past = course.steps[-1].seconds if course.steps else 0.0
            for step in self._session.streams.fit(model, FitJob(tuple(photos), settings, begin=begin)):
                yield replace(step, seconds=past + step.seconds)

        self._session.worker.submit(Job("fit", stream, self._value, ended))

    def _value(self, value: Shot | FitStep) -> None:
        if isinstance(value, Shot):
            self.course = replace(self.course, shots=(*self.course.shots, value))
            return
        self.course = self.course.stepped(value)
        self.race.stepped(value)
        self._unseen += 1
        due = self._unseen >= _LOOK_STEPS and time.monotonic() - self._looked > _LOOK_EVERY
        if due and self.course.at is None and not self._session.worker.busy("fit picture"):
            self._look(_LIVE)

    def _look(self, settings: RenderSettings) -> None:
        self._looked, self._unseen = time.monotonic(), 0
        model, step, view = self._session.model, self.course.step, self.course.view
        assert model is not None and step is not None
        camera = step.cameras[view]
        wide = (*self._session.viewport.panel, camera.height, self._session.viewport.pan)
        followed = self.followed
        whole = orbit.filling(camera, *(wide if followed else (camera.width, camera.height, camera.height)))
        job = RenderJob(step.codes, whole.camera, settings)

        def pictured(frame: Frame) -> None:
            if followed and self.followed:
                self._session.worker.cancel("view")
                self._session.viewport.put(frame, whole)
                self.live = self._session.viewport.frame
            shot = self.course.shot
            if shot and view == self.course.view:
                picture = whole.middle(camera).cropped(frame)
                difference = _doubled_difference(shot.pixels, picture.image)
                self.course = replace(self.course, picture=picture, difference=difference)

        stream, ended = self._session.streams.frames, self._session.reporting("Cannot draw the fit")
        # A hand that scrubs asks for many: each is shown before the next replaces it.
        urgent = self.course.at is not None
        self._session.worker.submit(Job("fit picture", lambda: stream(model, job), pictured, ended, urgent))

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Fitted")
            return
        self.running = False
        self.race.over()
        self._session.viewport.render()
        if not isinstance(error, NoBackgroundError):  # for which there is a dialog
            self._session.report("Cannot fit this image", error)

    def _finish(self, how: str) -> None:
        self.running = False
        self.race.over()
        self.course = replace(self.course, at=None)
        name, last = self.course.name, self.course.last
        if last is None:
            self._session.viewport.render()
            self._session.say(f"{how} before there was a result")
            return
        self._look(_FINISHED)
        self._session.adopt(Thing(name, last.codes, self.course.shots[0].photo), self.camera)
        self._session.say(f"{how} in {last.seconds:.0f} s: {name}, {last.psnr:.1f} dB")


def _doubled_difference(
    photo: UInt8[np.ndarray, "height width 3"], render: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Both at the photo's size; a render that is a preview is smaller."""
    enlarged = np.asarray(Image.fromarray(render).resize(photo.shape[1::-1]), np.int16)
    return (2 * np.abs(photo - enlarged)).clip(0, 255).astype(np.uint8)
