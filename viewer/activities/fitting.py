"""A fit under way: its photos, its steps so far, and the renders of the fitted object."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep, Hypothesis
from core.fitting.settings import PaperSettings
from core.geometry.camera import Camera
from core.models.scene import Scene
from core.photos.plain_background import NoBackgroundError
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.candidates import Candidates
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.fit_history import FitHistory, FittedPhoto, PhotoSource, match_poses
from viewer.values.objects import EditableObject

CHOICES = tuple(name for name, settings in PRESETS.items() if not isinstance(settings, PaperSettings))
"""Presets to choose from; the paper's own recipe is a baseline for the command line."""
_RESUMED_SHARE = 3
"""A fit that is resumed has one of so many steps of the preset: there is no search."""
_RENDER_EVERY = 0.3
"""s between two renders of the fit, which take their time from it"""
_RENDER_STEPS = 4
"""steps between two renders at the least, for machines on which they are slow"""
_LIVE = RenderSettings(samples=48, divisors=(2,))
_FINISHED = RenderSettings(divisors=(1,))


@dataclass(eq=False)
class FitOptions:
    """How the next fit is made, whichever model is open."""

    preset: str = "normal"
    estimate_focal: bool = False


class Fitting:
    """At most one fit at a time. Its result joins the objects and becomes current, a single edit."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport, options: FitOptions) -> None:
        self._jobs, self._editor, self._viewport, self.options = jobs, editor, viewport, options
        self.candidates = Candidates(jobs, editor.model)
        self.history = FitHistory()
        """of the fit under way, or of the last one"""
        self.running = False
        self.no_background: Callable[[tuple[PhotoSource, ...], int], None] = lambda sources, index: None
        """called with the photo in which the object was not found automatically"""
        self._scene_at_start: Scene | None = None
        self._rendered_at, self._steps_since = 0.0, 0
        """s on the monotonic clock, and steps, since the last render"""

    def close(self) -> None:
        """Drop a fit under way."""
        self._jobs.cancel("fit", "fit frame")
        self.candidates.close()
        self.running = False

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit the object in images; pose files (.txt) among them belong to the images of their names."""
        try:
            sources = match_poses(paths)
        except ValueError as error:
            self._jobs.report("Cannot fit this", error)
        else:
            self.fit(*sources)

    def fit(self, *sources: PhotoSource) -> bool:
        """Fit the object in photos. What cannot be used leaves everything as it was. Whether the fit has begun."""
        return bool(sources) and self._begin(FitHistory(sources))

    def add_photo(self, history: FitHistory, path: Path) -> None:
        """Fit once more, with another photo of the object."""
        self._begin(FitHistory((*history.sources, PhotoSource(path))))

    def set_pose(self, history: FitHistory, path: Path) -> None:
        """Fit once more, with the known camera of the photo that was shown."""
        sources = list(history.sources)
        sources[history.photo_index] = sources[history.photo_index]._replace(pose=path)
        self._begin(FitHistory(tuple(sources), photo_index=history.photo_index))

    def refit(self) -> None:
        """Fit the same photos once more, from the beginning."""
        self._run(FitHistory(self.history.sources, self.history.photos, photo_index=self.history.photo_index))

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue from a hypothesis, or from the step that is shown; the steps after that are forgotten."""
        initial = hypothesis or self.resume_point
        if initial is not None:
            self._run(self.history.up_to_selected(), initial)

    def resume_from_view(self) -> None:
        """Continue from what is on screen: its codes, and for the photo that is shown its camera."""
        if initial := self.resume_point:
            scene, cameras, index = self._editor.scene, list(initial.cameras), self.history.photo_index
            cameras[index] = scene.camera.resized(cameras[index].width, cameras[index].height)
            self.resume(replace(initial, cameras=tuple(cameras), codes=scene.codes))

    @property
    def resume_point(self) -> Hypothesis | None:
        """From where the step that is shown can be resumed; None where it cannot yet."""
        step = self.history.step
        best = step.hypotheses[0] if step and step.hypotheses else None
        return best if best and self.can_resume(best) else None

    def can_resume(self, hypothesis: Hypothesis) -> bool:
        """Whether a fit of all photos can continue from it; not if it is of some of them only."""
        return len(hypothesis.cameras) == len(self.history.photos)

    def stop(self) -> None:
        """End the fit here and keep what it has found."""
        if self.running:
            self._jobs.cancel("fit")
            self._finish("Stopped")

    # What is shown

    @property
    def is_followed(self) -> bool:
        """The view shows the fit on its way: nobody has changed the scene since it began, and the timeline rests."""
        return self.running and self._editor.scene == self._scene_at_start and self._viewport.source != "timeline"

    @property
    def camera(self) -> Camera:
        """The photo's camera in the step shown, at the size of the model's images. Only once there are steps."""
        assert self.history.step is not None, "no fit yet"
        return self._at_model_size(self.history.step.cameras[self.history.photo_index])

    @property
    def other_camera(self) -> Camera | None:
        """The runner-up's camera, mostly from the object's other side, at the same size; None where there is none."""
        other = self.history.step and self.history.step.runner_up
        return self._at_model_size(other.cameras[self.history.photo_index]) if other else None

    def scrub(self, index: int | None, gesture: str = "") -> None:
        """Show a step: its codes, seen from its camera, are an edit of the scene. None is the newest step."""
        if not self.history.steps:
            return
        last = len(self.history.steps) - 1
        self.history = replace(self.history, selected=None if index is None else max(0, min(index, last)))
        if step := self.history.step:
            self._editor.show(step.codes, self.camera, gesture)
            self._render(step, _LIVE)

    def show_photo(self, index: int) -> None:
        """Show another photo."""
        if 0 <= index < len(self.history.photos):
            self.history = replace(self.history, photo_index=index, frame=None, difference=None)
            if self.history.step:
                self._render(self.history.step, _LIVE)

    def keep(self) -> None:
        """Add the step that is shown to the objects."""
        if step := self.history.step:
            name = f"{self.history.name} at {step.seconds:.1f} s"
            self._editor.add_and_show(EditableObject(name, step.codes, self.history.photos[0].photo), self.camera)

    # On the way

    def _at_model_size(self, camera: Camera) -> Camera:
        size = self._editor.model.image_size
        return camera.resized(size, size)

    def _begin(self, history: FitHistory) -> bool:
        if self.running:
            self._jobs.notify("A fit is under way: stop it first")
            return False
        self._run(history)
        return True

    def _run(self, history: FitHistory, resume_from: Hypothesis | None = None) -> None:
        before, tiles = self.history, self.candidates.tiles
        self.close()
        self.candidates.reset(tiles if resume_from else ())
        self.history, self.running = history, True
        self._scene_at_start = self._editor.scene
        self._rendered_at, self._steps_since = 0.0, 0
        settings = replace(PRESETS[self.options.preset], estimate_focal=self.options.estimate_focal)
        if resume_from:
            settings = replace(settings, steps=max(1, settings.steps // _RESUMED_SHARE))

        def ended(error: Exception | None) -> None:
            read = len(self.history.photos)
            if error and len(self.history.steps) == len(history.steps):
                self.history = before
                self.candidates.reset(tiles)
            self._ended(error)
            if isinstance(error, NoBackgroundError):
                self.no_background(history.sources, read)

        self._jobs.submit(Job("fit", lambda: self._stream(history, settings, resume_from), self._receive, ended))

    def _stream(
        self, history: FitHistory, settings: FitSettings, resume_from: Hypothesis | None
    ) -> Iterator[FittedPhoto | FitStep | None]:
        """The photos that have not been read, then the steps; runs on the worker."""
        backend, model = self._jobs.backend, self._editor.model
        if resume_from is None:
            with suppress(ValueError):  # without a view bank, the steps that need one raise
                yield from backend.view_bank(model)
        photos = [fitted.photo for fitted in history.photos]
        for source in history.sources[len(photos) :]:
            photos.append(backend.load_photo(source.path, model, *source[1:]))
            yield FittedPhoto.of(source, photos[-1])
        past = history.steps[-1].seconds if history.steps else 0.0
        for step in backend.fit(model, FitJob(tuple(photos), settings, resume_from=resume_from)):
            yield replace(step, seconds=past + step.seconds)

    def _receive(self, value: FittedPhoto | FitStep) -> None:
        if isinstance(value, FittedPhoto):
            self.history = replace(self.history, photos=(*self.history.photos, value))
            return
        self.history = self.history.with_step(value)
        self.candidates.update(value)
        self._steps_since += 1
        due = self._steps_since >= _RENDER_STEPS and time.monotonic() - self._rendered_at > _RENDER_EVERY
        if due and self.history.selected is None and not self._jobs.busy("fit frame"):
            self._render(value, _LIVE)

    def _render(self, step: FitStep, settings: RenderSettings) -> None:
        """A step from the photo's camera; as wide as the view while that follows the fit."""
        self._rendered_at, self._steps_since = time.monotonic(), 0
        index, followed, view = self.history.photo_index, self.is_followed, self._viewport.settings
        camera = step.cameras[index]
        layout = (*view.panel, camera.height, view.pan) if followed else (camera.width, camera.height, camera.height)
        crop = orbit.fit_to_panel(camera, *layout)
        job = RenderJob(step.codes, crop.camera, settings)

        def rendered(frame: Frame) -> None:
            if followed and self.is_followed:
                self._viewport.display(frame, crop, "fit")
            if index == self.history.photo_index and (fitted := self.history.photo):
                middle = crop.middle(camera).cropped(frame)
                difference = _doubled_difference(fitted.pixels, middle.image)
                self.history = replace(self.history, frame=middle, difference=difference)

        frames, model = self._jobs.backend.frames, self._editor.model
        ended = self._jobs.reporting("Cannot render the fit")
        # While a person scrubs, each frame is shown before the next replaces it.
        urgent = self.history.selected is not None
        self._jobs.submit(Job("fit frame", lambda: frames(model, job), rendered, ended, urgent))

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Fitted")
            return
        self.running = False
        self.candidates.finish()
        self._viewport.release("fit")
        if not isinstance(error, NoBackgroundError):  # for which there is a dialog
            self._jobs.report("Cannot fit this image", error)

    def _finish(self, how: str) -> None:
        self.running = False
        self.candidates.finish()
        self.history = replace(self.history, selected=None)
        name, last = self.history.name, self.history.last
        if last is None:
            self._viewport.release("fit")
            self._jobs.notify(f"{how} before there was a result")
            return
        self._render(last, _FINISHED)
        self._editor.add_and_show(EditableObject(name, last.codes, self.history.photos[0].photo), self.camera)
        self._viewport.release("fit")
        self._jobs.notify(f"{how} in {last.seconds:.0f} s: {name}, {last.psnr:.1f} dB")


def _doubled_difference(
    photo: UInt8[np.ndarray, "height width 3"], render: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Both at the photo's size; a render that is a preview is smaller."""
    enlarged = np.asarray(Image.fromarray(render).resize(photo.shape[1::-1]), np.int16)
    return (2 * np.abs(photo - enlarged)).clip(0, 255).astype(np.uint8)
