"""The running fit, the queue of fits, and the questions about photos."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from core.classifiers.viewpoint import Side
from core.fitting.fit import FitStep, Hypothesis
from core.fitting.problem import MOST_PHOTOS
from core.models.model import Model
from core.photos.clip import is_clip
from viewer.activities.clip_frames import ClipRequest, is_of_clip, read_frames
from viewer.activities.fit_queue import FitQueue
from viewer.activities.fit_results import FitResults
from viewer.activities.fit_stream import Confirmed, FitOptions, FitValue, fit_stream
from viewer.activities.fit_view import FitView
from viewer.activities.photo_offers import PhotoOffers, describe
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import FIT_WEIGHT, Jobs
from viewer.services.messages import MessageKind, error_text
from viewer.services.worker import Job
from viewer.store.store import Store
from viewer.values.cut_out_preview import CutOutPreview
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource, Question, Ready, photo_sources
from viewer.values.objects import EditableObject

_NONE: Confirmed = {}


class Fitting:
    """Runs one fit at a time and queues the others."""

    def __init__(self, jobs: Jobs, editor: Editor, viewport: Viewport, options: FitOptions, store: Store) -> None:
        self._jobs = jobs
        self._editor = editor
        self._viewport = viewport
        self.options = options
        self._copies = store.copies  # of photos, which may wait longer than their files exist
        self.view = FitView(editor, viewport, jobs.models, store.fit)
        self.results = FitResults(editor, viewport)
        self.request: FitRequest | None = None  # the running fit's
        self._offers = PhotoOffers(self, jobs.messages)
        self.waiting = FitQueue()
        self._before = self.history  # the fit shown before the last one began
        self._shown_key = ""  # of the object in the view
        editor.object_chosen.connect(self._ask_later)

    @property
    def history(self) -> FitHistory:
        """The running fit, or the one shown last."""
        return self.view.history

    @property
    def shown(self) -> FitHistory:
        """The fit of the object in the view; empty if it has none, or until that is read."""
        if self.running and self._viewport.following:
            return self.history
        key = self._key
        is_found = not self.running or self.results.checking is not None
        return self.history if is_found and key and key == self.view.key else self.view.kept(key)

    @property
    def questions(self) -> tuple[Question, ...]:
        """The questions about photos: the one chosen last, then the oldest."""
        return self.waiting.questions

    @property
    def _key(self) -> str:
        """Key of the object in the view, of which its versions have the fit; "" for a model's object."""
        objects = self._editor.objects
        return objects[objects.root(self._editor.state.mix.a.shape)].key

    @property
    def question(self) -> Question | None:
        """The question to show; None while a fit is followed."""
        return None if self.running and self._viewport.following else self.waiting.question

    @property
    def running(self) -> bool:
        """True while a fit is running."""
        return self.request is not None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """Unfinished requests: the running fit, unless its preliminary result is there, questions and queue."""
        return (*self._unfinished, *self.waiting.pending)

    @property
    def _unfinished(self) -> tuple[FitRequest, ...]:
        """The running fit as a request to restart it; empty if its preliminary result is there."""
        if self.request is None or self.results.checking:
            return ()
        history = replace(self.request.history, photos=self.history.photos, model=self.history.model)
        return (self.request._replace(history=history),)

    @property
    def unfinished(self) -> FitQueue:
        """All that a new project takes over: the running fit, which begins again, queue and questions."""
        return replace(self.waiting, requests=(*self._unfinished, *self.waiting.requests))

    def take_over(self, unfinished: FitQueue) -> None:
        """Continue what another project left unfinished."""
        self.waiting = self.waiting.joined(unfinished)
        self._next()

    def close(self) -> None:
        """Cancel the running fit, the queue and the questions."""
        self._offers.close()
        self.waiting = FitQueue()
        self._drop()

    def tick(self) -> None:
        """Show the fit of the object in the view, if it is known; call once a frame."""
        key = self._key
        if key != self._shown_key:
            self._shown_key = key
            self.waiting = replace(self.waiting, chosen=None)
        if not self.running:
            self.view.show_kept(key)

    def restore(self, pending: tuple[FitRequest, ...]) -> None:
        """Continue unfinished requests; failed ones are questions."""
        requests = tuple(request for request in pending if not request.problem)
        questions = tuple(Question.of_failure(request) for request in pending if request.problem)
        self.take_over(FitQueue(requests, questions))

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit one object to image files; to more than an object keeps, an object to each, as to each video."""
        for path in filter(is_clip, paths):
            self.fit(PhotoSource(path))  # not copied, as its frames are
        images = tuple(path for path in paths if not is_clip(path))
        if not images:
            return
        sources, problems = photo_sources(images)
        note = describe(problems, len(images))
        if note:
            self._jobs.messages.notify(note, MessageKind.NOTE if sources else MessageKind.PROBLEM)
        sources = tuple(map(self._copies.keep, sources))
        if len(sources) > MOST_PHOTOS:
            self.fit_each(sources)
            return
        finished = FitHistory() if self.running and self._viewport.following else self.shown
        self.fit(*sources)
        if sources:
            self._offers.fit_otherwise(sources, finished, note)

    def ask_first(self, request: FitRequest) -> None:
        """Show a request's question before the others, and in place of a followed fit."""
        self._viewport.unfollow()
        self.waiting = self.waiting.asking_first(request)

    def fit(self, *sources: PhotoSource, model: str = "", confirmed: Confirmed = _NONE) -> None:
        """Begin or queue a fit of photos, if any, dropping questions about them.

        Args:
            model: the model's fingerprint; empty chooses by the category of the first photo.
        """
        self.waiting = self.waiting.without_questions(sources)
        if sources:
            self.begin(FitRequest(FitHistory(sources, model=model)), confirmed)

    def fit_each(self, sources: tuple[PhotoSource, ...]) -> None:
        """Fit an object to each photo, one after the other."""
        for source in sources:
            self.fit(source)
        if len(sources) > 1:
            text = f"{len(sources)} photos show an object each: they are fitted one after the other"
            self._jobs.messages.notify(text, MessageKind.NOTE)

    def add_photo(self, history: FitHistory, path: Path, side: Side | None = None) -> None:
        """Refine an object with another photo, and the side that it shows, if known."""
        self.refine(history, self._copies.keep(PhotoSource(path, side=side)))

    def refine(self, earlier: FitHistory, *added: PhotoSource, without: tuple[int, ...] = ()) -> None:
        """Fit photos from the earlier result, without a search if it can resume; those it left out are dropped.

        Args:
            without: numbers of photos to take out.
        """
        left_out = earlier.last.left_out if earlier.last else ()
        history = earlier.without_photos(*without, *left_out)
        initial = earlier.resume_point and earlier.resume_point.without((*without, *left_out))
        if not history.sources:  # the last photo that was not left out is taken out
            history = earlier.without_photos(*without)
            initial = None
        history = replace(history, sources=(*history.sources, *added))
        self.waiting = self.waiting.without_questions(history.sources)
        self.begin(FitRequest(history, initial, answered=len(history.photos)))

    def fit_again(self, history: FitHistory) -> None:
        """Fit the photos of a history from the beginning, without questions about those it has read."""
        self.begin(FitRequest(replace(history, steps=()), answered=len(history.photos)))

    def _ask_later(self) -> None:
        self.waiting = self.waiting.asking_later()

    def withdraw(self, sources: tuple[PhotoSource, ...]) -> None:
        """Cancel the fit of exactly these photos, waiting or running, without a result."""
        self.forget(sources)
        if self.request and self.history.sources is sources:
            self._drop()
            self.view.show(self._before)
            self._next()

    def refit(self, model: Model | None = None) -> None:
        """Fit the photos of the object in the view again, from the beginning; None keeps the model of the last fit."""
        history = replace(self.shown, photos=(), model=model.fingerprint) if model else self.shown
        self.begin(FitRequest(replace(history, steps=()), answered=len(history.sources)))

    # The running fit

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue the shown fit from a hypothesis, by default the best one of the newest step."""
        if initial := hypothesis or self.history.resume_point:
            self._run(FitRequest(self.history, initial))

    def resume_from_view(self) -> None:
        """Continue the shown fit from the view's codes and, for the selected photo, its direction."""
        scene = self._editor.scene
        if initial := self.history.resume_point_of(scene.instance, scene.camera):
            self.resume(initial)

    def stop(self) -> None:
        """End the running fit with its newest step as the result, and begin the next."""
        if self.running:
            self._jobs.cancel("fit")
            self.view.history = self.history.stopped()
            self._finish()
            self._next()

    def forget(self, sources: tuple[PhotoSource, ...]) -> None:
        """Remove the request of these photos from queue and questions."""
        self.waiting = self.waiting.without(sources)

    def remove_failed(self) -> None:
        """Remove all failed fits, and offer to undo that."""
        failed = tuple(question for question in self.questions if question.is_failed)
        for question in failed:
            self.forget(question.request.history.sources)
        self._offers.undo_removal(failed)

    def follow(self) -> None:
        """Let the view follow the running fit from the photo's camera, so that its result is shown."""
        if self.running and not self.results.checking and self.history.last:
            self._viewport.follow()

    # Progress

    def begin(self, request: FitRequest, confirmed: Confirmed = _NONE) -> None:
        """Run a request now, or queue it."""
        unfinished = {source for waiting in self.pending for source in waiting.history.sources}
        cuts = {source: cut for source, cut in self.waiting.confirmed.items() if source in unfinished}
        cuts |= {source: confirmed[source] for source in request.history.sources if source in confirmed}
        self.waiting = replace(self.waiting, confirmed=cuts)
        if not self.running:
            self._run(request)
            return
        self.waiting = self.waiting.joined(FitQueue((request,)))

    def _next(self) -> None:
        """Run the next request without following it: a person may be editing the last result."""
        if self.waiting.requests and not self.running:
            request, *later = self.waiting.requests
            self.waiting = replace(self.waiting, requests=tuple(later))
            self._run(request, follow=False)

    def _drop(self) -> None:
        """Cancel the running fit without a result."""
        self._jobs.cancel("fit")
        self._viewport.unfollow()
        self.request = self.results.checking = None

    def _run(self, request: FitRequest, follow: bool = True) -> None:
        self._before = self.history
        self._drop()
        self.view.show(request.history)
        self.request = request
        if follow:
            self.waiting = replace(self.waiting, chosen=None)
            self._viewport.follow()
        stream = partial(self._stream, request, self._editor.model, self.waiting.confirmed)
        self._jobs.submit(Job("fit", stream, self._receive, self._ended, weight=FIT_WEIGHT))

    def _stream(
        self, request: FitRequest, here: Model, confirmed: Confirmed
    ) -> Iterator[float | ClipRequest | FitValue | None]:
        """Read the video of a request, if it is of one, then fit the photos."""
        if is_of_clip(request, confirmed):
            request, confirmed, _ = yield from read_frames(self._jobs.backend, request, self._copies.keep)
        yield from fit_stream(self._jobs, here, request, self.options.settings(request.refines), confirmed)

    def _receive(self, value: float | ClipRequest | FitValue) -> None:
        if isinstance(value, float):
            self.view.read_fraction = value
        elif isinstance(value, ClipRequest):
            self.request = value.request
            self.view.show(value.request.history)
            self.waiting = replace(self.waiting, confirmed={**self.waiting.confirmed, **value.confirmed})
            if value.note:
                name = value.request.history.sources[0].name
                self._jobs.messages.notify(f"{name}: {value.note}", MessageKind.NOTE)
        elif isinstance(value, Model):
            self.view.history = replace(self.history, model=value.fingerprint)
        elif isinstance(value, Question):
            self._ask(value)
        elif isinstance(value, CutOutPreview):
            self.view.preview = value
        elif isinstance(value, FittedPhoto):
            self.view.history = replace(self.history, photos=(*self.history.photos, value))
            if value.photo.note:
                self._jobs.messages.notify(f"{value.source.name}: {value.photo.note}", MessageKind.NOTE)
        else:
            if value.restart and not self.results.checking and self.history.last:
                self.results.checking = self._add(self.history.last)  # while a second search goes on
                self._viewport.unfollow()
            self.view.add_step(value)

    def _ask(self, question: Question) -> None:
        """Ask a question about the running request, and run the next."""
        (request,) = self._unfinished
        self._drop()
        self.view.show(self._before)
        question = question._replace(request=request)  # with the photos read so far
        self.waiting = self.waiting.joined(FitQueue(questions=(question,)))
        self._next()

    def _ended(self, error: Exception | None) -> None:
        self._fail(error) if error else self._finish()
        self._next()

    def _fail(self, error: Exception) -> None:
        """Report an error and, unless the object can be used already, keep the request to try it again."""
        self._jobs.messages.report("Cannot fit this image", error)
        preview = self.view.preview or (self.history.photo.preview if self.history.photo else None)
        is_usable = self.results.checking is not None
        for request in self._unfinished:
            failed = request._replace(problem=error_text(error))
            self.waiting = self.waiting.joined(FitQueue(questions=(Question.of_failure(failed, preview),)))
            if self._viewport.following:
                self.waiting = replace(self.waiting, chosen=failed)
        self._drop()
        if not is_usable:
            self.view.show(self._before)

    def _finish(self) -> None:
        last = self.history.last
        checking = self.results.checking
        if last is None:
            self._jobs.messages.notify("Stopped before there was a result", MessageKind.NOTE)
        elif checking:
            self.view.keep(self._editor.objects[checking.name].key)
            if self.results.improve(checking, self._fitted(last), self.view.camera_of(last)):
                self._jobs.messages.notify(f"{checking.name}: a better viewpoint was found")
        else:
            self._add(last)
            self._offers.fit_left_out(tuple(self.history.sources[number] for number in last.left_out))
        self.request = self.results.checking = None
        self._viewport.unfollow()

    def _add(self, step: FitStep) -> Ready:
        """Add a step's result to the objects, and keep its fit."""
        ready = self.results.add(self._fitted(step), self.view.camera_of(step))
        self.view.keep(self._editor.objects[ready.name].key)
        return ready

    def _fitted(self, step: FitStep) -> EditableObject:
        photos = len(step.cameras) - len(step.left_out)
        name = f"{self.history.name}, {photos} photos" if photos > 1 else self.history.name
        return EditableObject(name, step.instance, True, step.confidence)
