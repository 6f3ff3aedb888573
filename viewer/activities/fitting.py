"""A fit under way, and those that wait: photos, steps so far, and the renders of the fitted object."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from core.export.keyframes import View
from core.fitting.fit import FitStep, Hypothesis
from core.fitting.plausibility import describe_category, likeliest_category
from core.geometry.camera import Camera
from core.photos.plain_background import NoBackgroundError
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.activities.candidates import Candidates
from viewer.activities.fit_stream import CategoryGuess, FitOptions, fit_stream
from viewer.activities.following import LIVE, Following
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource, Ready, match_poses
from viewer.values.objects import EditableObject

_RENDER_EVERY = 0.3
"""s between two renders of the fit, which take their time from it"""
_RENDER_STEPS = 4
"""steps between two renders at the least, for machines on which they are slow"""
_SURE_CATEGORY = 0.8
"""Probability from which a photo is fitted with the model of the category that it shows, whichever is open."""
_FINISHED = RenderSettings(divisors=(1,))


class Fitting:
    """One fit at a time, the others wait. A result joins the objects; it becomes current where the view followed it."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport, options: FitOptions) -> None:
        self._jobs, self._editor, self._viewport, self.options = jobs, editor, viewport, options
        self.candidates = Candidates(jobs, editor.model)
        self.following = Following(jobs, editor, viewport)
        self.history = FitHistory()
        """of the fit under way, or of the last one"""
        self.queue: tuple[FitRequest, ...] = ()
        """those that wait"""
        self.ready: Ready | None = None
        """the newest result that was not shown, as something else was being edited"""
        self.result: Ready | None = None
        """what the fit under way has handed over while it is still being checked"""
        self.no_background: Callable[[tuple[PhotoSource, ...], int], None] = lambda sources, index: None
        """called with the photo in which the object was not found automatically"""
        self.request: FitRequest | None = None
        """what is under way"""
        self.other_category: Callable[[tuple[PhotoSource, ...], str], None] = lambda sources, category: None
        """called with photos that show another category, whose fit is withdrawn"""
        self._before = self.history, self.candidates.tiles
        """what was there before the last fit began"""
        self._rendered_at, self._steps_since = 0.0, 0
        """s on the monotonic clock, and steps, since the last render"""

    @property
    def running(self) -> bool:
        """A fit is under way."""
        return self.request is not None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """What is not over: the fit under way, unless its result is there already, and those that wait."""
        if self.request is None or self.result:
            return self.queue
        begun = replace(self.request.history, photos=self.history.photos)
        return (self.request._replace(history=begun), *self.queue)

    def close(self) -> None:
        """Drop a fit under way, and those that wait."""
        self.queue = ()
        self._drop()

    def restore(self, history: FitHistory, pending: tuple[FitRequest, ...]) -> None:
        """Bring back the last fit, and go on with what is not over."""
        self.history, self.queue = history, pending
        if history.step:
            self._render(history.step, _FINISHED)
        self._next()

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit the object in images; pose files (.txt) among them belong to the images of their names."""
        try:
            sources = match_poses(paths)
        except ValueError as error:
            self._jobs.report("Cannot rebuild this", error)
        else:
            self.fit(*sources)

    def fit(self, *sources: PhotoSource) -> bool:
        """Fit the object in photos, after those that wait. What cannot be used leaves everything as it was. Whether
        there is anything to fit.
        """
        if sources:
            self._begin(FitHistory(sources))
        return bool(sources)

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
        sources, photos, index = self.history.sources, self.history.photos, self.history.photo_index
        self._run(FitRequest(FitHistory(sources, photos, photo_index=index)))

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue from a hypothesis, or from the step that is shown; the steps after that are forgotten."""
        initial = hypothesis or self.resume_point
        if initial is not None:
            self._run(FitRequest(self.history.up_to_selected(), initial))

    def resume_from_view(self) -> None:
        """Continue from what is on screen: its codes, and for the photo that is shown its camera."""
        if initial := self.resume_point:
            scene, cameras, index = self._editor.scene, list(initial.cameras), self.history.photo_index
            seen, found = scene.camera, cameras[index]
            if self.history.photos[index].photo.cropped:  # its size in the view is not that in the photo
                cameras[index] = replace(found, azimuth=seen.azimuth, elevation=seen.elevation)
            else:
                cameras[index] = seen.resized(found.width, found.height)
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
        """End the fit here and keep what it has found; the next one begins."""
        if self.running:
            self._jobs.cancel("fit")
            self._finish("Stopped")
            self._next()

    def clear_queue(self) -> None:
        """Forget the fits that wait."""
        self.queue = ()

    # What is shown

    @property
    def is_followed(self) -> bool:
        """The view shows the fit on its way; see :class:`~viewer.activities.following.Following`."""
        return self.running and self.following.active

    @property
    def can_follow(self) -> bool:
        """There is a fit on its way that the view does not show from the photo's camera."""
        shown = self.is_followed and not self.following.turned
        return self.running and not self.result and self.history.last is not None and not shown

    def follow(self) -> None:
        """Show the fit on its way, from the photo's camera; its result becomes current."""
        if self.can_follow:
            self.following.begin()

    def show_ready(self) -> None:
        """Make the result that waits current."""
        if self.ready:
            self._editor.show_added(self.ready.name, self.ready.camera)
            self.ready = None

    def dismiss_ready(self) -> None:
        """Leave it among the objects."""
        self.ready = None

    def rename(self, name: str, to: str) -> None:
        """A result has another name."""
        if self.ready and self.ready.name == name:
            self.ready = replace(self.ready, name=to)
        if self.result and self.result.name == name:
            self.result = replace(self.result, name=to)

    @property
    def camera(self) -> Camera:
        """The photo's camera in the step shown, at the size of the model's images. Only once there are steps."""
        assert self.history.step is not None, "nothing found yet"
        return self._camera_of(self.history.step)

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
            self._render(step, LIVE)

    def show_photo(self, index: int) -> None:
        """Show another photo."""
        if 0 <= index < len(self.history.photos):
            self.history = replace(self.history, photo_index=index, frame=None, difference=None)
            if self.history.step:
                self._render(self.history.step, LIVE)

    def keep(self) -> None:
        """Add the step that is shown to the objects."""
        if step := self.history.step:
            name = f"{self.history.name} at {step.seconds:.1f} s"
            self._editor.add_and_show(replace(self._fitted(step), name=name), self.camera)

    # On the way

    def _at_model_size(self, camera: Camera) -> Camera:
        size = self._editor.model.image_size
        return camera.resized(size, size)

    def _begin(self, history: FitHistory) -> None:
        """Now, or after those that wait."""
        if not self.running:
            self._run(FitRequest(history))
            return
        self.queue = (*self.queue, FitRequest(history))
        self._jobs.notify(f"{history.name} waits for the photo before it")

    def _next(self) -> None:
        """Those that waited are not followed: what is edited may be the result before them."""
        if self.queue and not self.running:
            request, self.queue = self.queue[0], self.queue[1:]
            self._run(request, follow=False)

    def _drop(self) -> None:
        """End what is under way; nothing of it is kept."""
        self._jobs.cancel("fit", "fit frame")
        self.candidates.close()
        self.following.end()
        self.request = self.result = None

    def _check_category(self, guess: CategoryGuess) -> None:
        """A photo of another category is handed over; of one that nobody knows, a person is told."""
        warning = describe_category(guess, self._editor.model.category)
        likeliest = likeliest_category(guess)
        if warning and likeliest and guess[likeliest] > _SURE_CATEGORY:
            sources = self.history.sources
            self._withdraw()
            self.other_category(sources, likeliest)
            self._next()
        elif warning:
            self._jobs.notify(f"{self.history.name}: {warning}")

    def _withdraw(self) -> None:
        """Undo the beginning of a fit."""
        history, tiles = self._before
        self._drop()
        self.history = history
        self.candidates.reset(tiles)

    def _run(self, request: FitRequest, follow: bool = True) -> None:
        self._before = before, tiles = self.history, self.candidates.tiles
        history, resume_from = request
        self._drop()
        self.candidates.reset(tiles if resume_from else ())
        self.history, self.request = history, request
        if follow:
            self.following.begin()
        self._rendered_at, self._steps_since = 0.0, 0
        backend, model = self._jobs.backend, self._editor.model
        stream = partial(fit_stream, backend, model, request, self.options.settings(resume_from is not None))

        def ended(error: Exception | None) -> None:
            read = len(self.history.photos)
            if error and len(self.history.steps) == len(history.steps):
                self.history = before
                self.candidates.reset(tiles)
            self._ended(error)
            if isinstance(error, NoBackgroundError):
                self.no_background(history.sources, read)
            self._next()

        self._jobs.submit(Job("fit", stream, self._receive, ended))

    def _receive(self, value: FittedPhoto | CategoryGuess | FitStep) -> None:
        if isinstance(value, CategoryGuess):
            self._check_category(value)
            return
        if isinstance(value, FittedPhoto):
            self.history = replace(self.history, photos=(*self.history.photos, value))
            return
        if value.restart and not self.result and self.history.last:
            self._hand_over(self.history.last)
        self.history = self.history.with_step(value)
        self.candidates.update(value)
        self.following.update(View(value.codes, self._camera_of(value)))
        self._steps_since += 1
        due = self._steps_since >= _RENDER_STEPS and time.monotonic() - self._rendered_at > _RENDER_EVERY
        if due and self.history.selected is None and not self._jobs.busy("fit frame"):
            self._render(value, LIVE)
            self.following.render_turned()

    def _render(self, step: FitStep, settings: RenderSettings) -> None:
        """A step from the photo's camera; as wide as the view while that follows the fit from there."""
        self._rendered_at, self._steps_since = time.monotonic(), 0
        index, view = self.history.photo_index, self._viewport.settings
        followed = self.is_followed and not self.following.turned
        camera = step.cameras[index]
        layout = (*view.panel, camera.height, view.pan) if followed else (camera.width, camera.height, camera.height)
        crop = orbit.fit_to_panel(camera, *layout)
        job = RenderJob(step.codes, crop.camera, settings)

        def rendered(frame: Frame) -> None:
            if followed and self.is_followed and not self.following.turned:
                self._viewport.display(frame, crop, "fit")
            if index == self.history.photo_index and (fitted := self.history.photo):
                middle = crop.middle(camera).cropped(frame)
                difference = fitted.doubled_difference(middle.image)
                self.history = replace(self.history, frame=middle, difference=difference)

        frames, model = self._jobs.backend.frames, self._editor.model
        ended = self._jobs.reporting("Cannot show the search")
        # While a person scrubs, each frame is shown before the next replaces it.
        urgent = self.history.selected is not None
        self._jobs.submit(Job("fit frame", lambda: frames(model, job), rendered, ended, urgent))

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Rebuilt")
            return
        self.request = self.result = None
        self.candidates.finish()
        self.following.end()
        if not isinstance(error, NoBackgroundError):  # for which there is a dialog
            self._jobs.report("Cannot rebuild this image", error)

    def _finish(self, how: str) -> None:
        self.candidates.finish()
        self.history = replace(self.history, selected=None)
        name, last = self.history.name, self.history.last
        if last is None:
            self._jobs.notify(f"{how} before there was a result")
        elif self.result:
            self._improve(self.result, last)
        else:
            self._render(last, _FINISHED)
            self._add(last)
            self._jobs.notify(f"{how} in {last.seconds:.0f} s: {name}, {last.psnr:.1f} dB")
        self.request = self.result = None
        self.following.end()

    def _hand_over(self, first: FitStep) -> None:
        """The first search has a result: it can be used while the second one checks it."""
        self.result = self._add(first)
        self.following.end()
        self._jobs.notify(f"{self.result.name} can be used: {first.psnr:.1f} dB; it is being checked from other sides")

    def _improve(self, handed: Ready, last: FitStep) -> None:
        """The second search has ended, or was stopped."""
        self._render(last, _FINISHED)
        found, name = self._camera_of(last), handed.name
        better = last.codes != self._editor.objects[name].codes
        turned = self._editor.scene.camera != handed.camera
        shown = self._editor.improve(name, self._fitted(last), self._editor.scene.camera if turned else found)
        if better and not shown and name not in self._editor.objects.removed:
            self.ready = Ready(name, found)
        verdict = f"a better one was found, {last.psnr:.1f} dB" if better else "the first result stays"
        self._jobs.notify(f"{name} was checked from other sides: {verdict}")

    def _add(self, step: FitStep) -> Ready:
        """A result joins the objects, and becomes current where the view has followed it."""
        camera = self._camera_of(step)
        if self.is_followed:
            seen_from = self._editor.scene.camera if self.following.turned else camera
            return Ready(self._editor.add_and_show(self._fitted(step), seen_from), camera)
        self.ready = Ready(self._editor.objects.add(self._fitted(step)), camera)
        return self.ready

    def _fitted(self, step: FitStep) -> EditableObject:
        return EditableObject(self.history.name, step.codes, True, step.confidence)

    def _camera_of(self, step: FitStep) -> Camera:
        """Of the photo that is shown, at the size of the model's images."""
        return self._at_model_size(step.cameras[self.history.photo_index])
