"""The fit under way, and those that wait for it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from core.fitting.fit import FitStep, Hypothesis
from core.fitting.photo_detail import with_photo_detail
from core.models.model import Model
from core.photos.photo import DOUBTFUL_MASK
from core.photos.plain_background import NoBackgroundError
from viewer.activities.candidates import Candidates
from viewer.activities.fit_results import FitResults
from viewer.activities.fit_stream import ChosenModel, FitOptions, Remark, fit_stream
from viewer.activities.fit_view import FitView
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import FIT_SHARE, Jobs
from viewer.services.messages import Button, MessageKind
from viewer.services.signal import Signal
from viewer.services.worker import Job
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource, Ready, match_poses
from viewer.values.objects import EditableObject
from viewer.values.printable import printable

_FITS = 8  # which are kept
_NAMED = 3  # files that a message names


class Fitting:
    """One fit at a time, the others wait: the queue. What it shows is in ``view``, what it has found in ``results``."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport, options: FitOptions) -> None:
        self._jobs, self._editor, self._viewport, self.options = jobs, editor, viewport, options
        self.candidates = Candidates(jobs)
        self.view = FitView(jobs, editor, viewport)
        self.results = FitResults(editor, viewport)
        self.request: FitRequest | None = None  # what is under way
        self.queue: tuple[FitRequest, ...] = ()  # those that wait
        self.no_background = Signal[tuple[PhotoSource, ...], int]()  # photos, and the one whose object was not found
        self._a = editor.state.mix.a  # in the last frame
        self._shown_fit, self._fits = "", dict[str, FitHistory]()  # object whose fit is shown; fits by name
        self._before = self.history, self.candidates.tiles  # what was there before the last fit began

    @property
    def history(self) -> FitHistory:
        """Of the fit under way, or of the last one."""
        return self.view.history

    @property
    def running(self) -> bool:
        """A fit is under way."""
        return self.request is not None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """Requests that are not over: the fit under way, unless its result is there, and those that wait."""
        return (*self._unfinished, *self.queue)

    @property
    def _unfinished(self) -> tuple[FitRequest, ...]:
        """The fit under way, to be begun anew; none where its result is there."""
        if self.request is None or self.results.checking:
            return ()
        history = replace(self.request.history, photos=self.history.photos, model=self.history.model)
        return (self.request._replace(history=history),)

    def close(self) -> None:
        """Drop a fit under way, and those that wait."""
        self.queue = ()
        self._drop()

    def tick(self) -> None:
        """Once a frame: when another object becomes A, show how that was found, if it was in this run."""
        before, self._a = self._a, self._editor.state.mix.a
        name, texture = self._a
        if self._a == before or self.running or name != texture or name == self._shown_fit or name not in self._fits:
            return
        self._shown_fit = name
        self.view.show(self._fits[name])
        self.candidates.reset()
        self.view.finish()

    def restore(self, history: FitHistory, pending: tuple[FitRequest, ...]) -> None:
        """Bring back the last fit, unless there is one already, and go on with what is not over."""
        if not self.history.sources:
            self.view.show(history)
            self.view.finish()
            found = (one.name for one in self._editor.objects.added if history.last and one.codes == history.last.codes)
            if name := next(found, ""):
                self._keep_fit(name)
        self.queue = (*self.queue, *(request._replace(restored=True) for request in pending))
        self._next()

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit the object in images; pose files (.txt) among them belong to the images of their names."""
        try:
            sources, others = match_poses(paths)
        except ValueError as error:
            self._jobs.messages.report("Cannot rebuild this", error)
            return
        if others:
            names = ", ".join(printable(path.name) for path in others[:_NAMED])
            more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
            self._jobs.messages.notify(f"Left out {names}{more}: neither image nor pose", MessageKind.NOTE)
        self.fit(*sources)

    def fit(self, *sources: PhotoSource, model: str = "") -> bool:
        """Fit the object in photos, after those that wait. What cannot be used leaves everything as it was. Whether
        there is anything to fit.

        Args:
            model: fingerprint; empty: that of the category that the first photo shows.
        """
        if sources:
            self._begin(FitHistory(sources, model=model))
        return bool(sources)

    def add_photo(self, history: FitHistory, path: Path) -> None:
        """Fit once more, with another photo of the object."""
        self._begin(FitHistory((*history.sources, PhotoSource(path)), model=history.model))

    def set_pose(self, history: FitHistory, path: Path) -> None:
        """Fit once more, with the known camera of the photo that was shown."""
        sources = list(history.sources)
        sources[history.photo_index] = sources[history.photo_index]._replace(pose=path)
        self._begin(FitHistory(tuple(sources), photo_index=history.photo_index, model=history.model))

    def refit(self) -> None:
        """Fit the same photos once more, from the beginning."""
        fresh = FitHistory(self.history.sources, self.history.photos, model=self.history.model)
        self._run(FitRequest(replace(fresh, photo_index=self.history.photo_index)))

    def refit_as(self, model: Model) -> None:
        """Fit the same photos as an object of another category."""
        self._begin(FitHistory(self.history.sources, model=model.fingerprint))

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue from a hypothesis, or from the step that is shown; the steps after that are forgotten."""
        initial = hypothesis or self.resume_point
        if initial is not None:
            self._run(FitRequest(self.history.up_to_selected(), initial))

    def resume_from_view(self) -> None:
        """Continue from what is on screen: its codes, and for the photo that is shown its camera."""
        if initial := self.resume_point:
            scene, cameras, index = self._editor.scene, list(initial.cameras), self.history.photo_index
            seen = scene.camera  # how large the object is in the view is not how large it is in the photo
            cameras[index] = replace(cameras[index], azimuth=seen.azimuth, elevation=seen.elevation)
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
            if self.history.steps:
                *before, last = self.history.steps
                self.view.history = replace(self.history, steps=(*before, self._with_detail(last)))
            self._finish("Stopped")
            self._next()

    def withdraw(self) -> None:
        """Undo the beginning of the fit under way; the next one begins."""
        self._undo_beginning()
        self._next()

    def _undo_beginning(self) -> None:
        history, tiles = self._before
        self._drop()
        self.view.show(history)
        self.candidates.reset(tiles)

    def begin_now(self, sources: tuple[PhotoSource, ...]) -> None:
        """Fit photos that wait, before all others. A fit under way waits in their place, to begin anew; one that is
        being checked ends with its result.
        """
        request = next((one for one in self.queue if one.history.sources is sources), None)
        if request is None:
            return
        left, self.queue = (*self._unfinished, *_without(self.queue, sources)), ()
        self.stop() if self.results.checking else self._undo_beginning()
        self.queue = left
        self._run(request)

    def forget(self, sources: tuple[PhotoSource, ...]) -> None:
        """Do not fit photos that wait."""
        self.queue = _without(self.queue, sources)

    @property
    def can_follow(self) -> bool:
        """There is a fit on its way that the view does not show from the photo's camera."""
        shown = self._viewport.following and not self._viewport.turned
        return self.running and not self.results.checking and self.history.last is not None and not shown

    def follow(self) -> None:
        """Show the fit on its way, from the photo's camera; its result becomes current."""
        if self.can_follow:
            self._viewport.follow()

    def rename(self, name: str, to: str) -> None:
        """A result has another name."""
        self.results.rename(name, to)
        self._fits = {to if one == name else one: fit for one, fit in self._fits.items()}
        self._shown_fit = to if self._shown_fit == name else self._shown_fit

    def _keep_fit(self, name: str) -> None:
        self._fits[name], self._shown_fit = self.history, name
        while len(self._fits) > _FITS:
            del self._fits[next(iter(self._fits))]

    def keep(self) -> None:
        """Add the step that is shown to the objects."""
        if step := self.history.step:
            name = f"{self.history.name} at {step.seconds:.1f} s"
            self._editor.add_and_show(replace(self._fitted(self._with_detail(step)), name=name), self.view.camera)

    # On the way

    def _begin(self, history: FitHistory) -> None:
        """Now, or after those that wait."""
        if not self.running:
            self._run(FitRequest(history))
            return
        self.queue = (*self.queue, FitRequest(history))
        self._jobs.messages.notify(f"{history.name} waits for the photo before it", MessageKind.NOTE)

    def _next(self) -> None:
        """Those that waited are not followed: what is edited may be the result before them."""
        if self.queue and not self.running:
            request, self.queue = self.queue[0], self.queue[1:]
            self._run(request, follow=False)

    def _drop(self) -> None:
        """End what is under way; nothing of it is kept."""
        self._jobs.cancel("fit")
        self.candidates.close()
        self.view.close()
        self.request = self.results.checking = None

    def _run(self, request: FitRequest, follow: bool = True) -> None:
        self._before = before, tiles = self.history, self.candidates.tiles
        history, resume_from = request.history, request.resume_from
        self._drop()
        self.candidates.reset(tiles if resume_from else ())
        self.view.show(history)
        self.request = request
        if follow:
            self._viewport.follow()
        settings = self.options.settings(resume_from is not None)
        stream = partial(fit_stream, self._jobs.backend, self._jobs.models, self._editor.model, request, settings)

        def ended(error: Exception | None) -> None:
            read = len(self.history.photos)
            if error and len(self.history.steps) == len(history.steps):
                self.view.show(before)
                self.candidates.reset(tiles)
            self._ended(error)
            if isinstance(error, NoBackgroundError):
                self.no_background.emit(history.sources, read)
            self._next()

        self._jobs.submit(Job("fit", stream, self._receive, ended, share=FIT_SHARE))

    def _receive(self, value: ChosenModel | Remark | FittedPhoto | FitStep) -> None:
        if isinstance(value, ChosenModel):
            self.view.history = replace(self.history, model=value.model.fingerprint)
            self._warn(value.warning)
        elif isinstance(value, Remark):
            self._jobs.messages.notify(value, MessageKind.NOTE)
        elif isinstance(value, FittedPhoto):
            self.view.history = replace(self.history, photos=(*self.history.photos, value))
            self._check_mask(value)
        else:
            if value.restart and not self.results.checking and self.history.last:
                self._hand_over(self.history.last)
            self.candidates.update(value)
            self.view.add_step(value)

    def _check_mask(self, fitted: FittedPhoto) -> None:
        """Tell how the file was read, and ask about a doubtful mask unless a person pointed at the object."""
        if fitted.photo.note:
            self._jobs.messages.notify(f"{fitted.source.name}: {fitted.photo.note}", MessageKind.NOTE)
        if fitted.photo.mask_confidence >= DOUBTFUL_MASK or fitted.source.hints:
            return
        sources, index = self.history.sources, len(self.history.photos) - 1
        point = Button("Point at it", lambda: self.no_background.emit(sources, index))
        self._jobs.messages.notify(
            f"{fitted.source.name}: is the object cut out well?", MessageKind.NOTE, buttons=(point,)
        )

    def _warn(self, warning: str) -> None:
        """Of a photo that nobody knows; a person decides."""
        if warning:
            begun = self.request
            stop = Button("Stop", lambda: self.withdraw() if self.request is begun else None)
            buttons = Button("Go on", lambda: None), stop
            self._jobs.messages.notify(f"{self.history.name}: {warning}", MessageKind.NOTE, buttons=buttons)

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Rebuilt")
            return
        self.request = self.results.checking = None
        self.candidates.finish()
        self._viewport.unfollow()
        if not isinstance(error, NoBackgroundError):  # for which there is a dialog
            self._jobs.messages.report("Cannot rebuild this image", error)

    def _finish(self, how: str) -> None:
        self.candidates.finish()
        self.view.finish()
        last, checking = self.history.last, self.results.checking
        if last is None:
            self._jobs.messages.notify(f"{how} before there was a result", MessageKind.NOTE)
        elif checking:
            self._keep_fit(checking.name)
            better = self.results.improve(checking, self._fitted(last), self.view.camera_of(last))
            verdict = "a better viewpoint was found" if better else "the first result stays"
            self._tell(f"{checking.name} was checked from other sides: {verdict}", checking)
        else:
            found = self._add(last)
            self._keep_fit(found.name)
            self._tell(f"{how} in {last.seconds:.0f} s: {found.name}", found)
        self.request = self.results.checking = None
        self._viewport.unfollow()

    def _hand_over(self, first: FitStep) -> None:
        """The first search has a result: it can be used while the second one checks it."""
        found = self.results.checking = self._add(first)
        self._viewport.unfollow()
        self._tell(f"{found.name} can be used; it is being checked from other sides", found)

    def _add(self, step: FitStep) -> Ready:
        restored = self.request is not None and self.request.restored
        return self.results.add(self._fitted(step), self.view.camera_of(step), restored)

    def _tell(self, text: str, found: Ready) -> None:
        """About a result, with a button that shows it where something else is being edited."""
        waits, show = found.name in self.results.unseen, Button("Show", lambda: self.results.show(found.name))
        self._jobs.messages.notify(text, buttons=(show,) if waits else ())

    def _with_detail(self, step: FitStep) -> FitStep:
        """What the photos add to the codes comes with the last step of a fit only."""
        if step.codes.detail or not step.hypotheses or not self.can_resume(step.hypotheses[0]):
            return step
        return with_photo_detail(self.view.model, [fitted.photo for fitted in self.history.photos], step)

    def _fitted(self, step: FitStep) -> EditableObject:
        photo = self.history.photo
        return EditableObject(self.history.name, step.codes, True, step.confidence, photo.digest if photo else "")


def _without(queue: tuple[FitRequest, ...], sources: tuple[PhotoSource, ...]) -> tuple[FitRequest, ...]:
    return tuple(request for request in queue if request.history.sources is not sources)
