"""The running fit, the queue of fits, and the questions about photos."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from core.classifiers.viewpoint import Side
from core.fitting.fit import FitStep, Hypothesis
from core.fitting.photo_views import with_photo_detail
from core.fitting.problem import MOST_PHOTOS
from core.models.model import Model
from core.photos.clip import is_clip
from core.photos.segmentation import Hints
from viewer.activities.clip_frames import ClipRequest, ReadFraction, is_of_clip, read_frames
from viewer.activities.fit_queue import FitQueue
from viewer.activities.fit_results import FitResults
from viewer.activities.fit_stream import Confirmed, Doubt, FitOptions, fit_stream
from viewer.activities.fit_view import FitView
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import FIT_WEIGHT, Jobs
from viewer.services.messages import Button, MessageKind, error_text
from viewer.services.worker import Job
from viewer.store.store import Store
from viewer.values.cut_out_preview import CutOutPreview
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource, Question, Ready, photo_sources
from viewer.values.objects import EditableObject
from viewer.values.printable import printable

_NAMED = 3  # files that a message names
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
        self._closed = False  # buttons of messages outlive the session
        self._waiting = FitQueue()
        self._before = self.history  # the fit shown before the last one began
        self._shown_key = ""  # of the object in the view
        editor.object_chosen.connect(self._set_questions_aside)

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
    def queue(self) -> tuple[FitRequest, ...]:
        """The requests that wait for their turn, the next first."""
        return self._waiting.requests

    @property
    def questions(self) -> tuple[Question, ...]:
        """The questions about photos: the one chosen last, then the oldest."""
        return self._waiting.questions

    @property
    def _key(self) -> str:
        """Key of the object in the view, of which its versions have the fit; "" for a model's object."""
        objects = self._editor.objects
        return objects[objects.root(self._editor.state.mix.a.shape)].key

    @property
    def question(self) -> Question | None:
        """The question to show; None while a fit is followed."""
        return None if self.running and self._viewport.following else self._waiting.question

    def _set_questions_aside(self) -> None:
        self._waiting = self._waiting.asking_later()

    @property
    def running(self) -> bool:
        """True while a fit is running."""
        return self.request is not None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """Unfinished requests: the running fit, unless its preliminary result is there, questions and queue."""
        return (*self._unfinished, *self._waiting.pending)

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
        return replace(self._waiting, requests=(*self._unfinished, *self.queue))

    def take_over(self, unfinished: FitQueue) -> None:
        """Continue what another project left unfinished."""
        self._waiting = self._waiting.joined(unfinished)
        self._next()

    def close(self) -> None:
        """Cancel the running fit, the queue and the questions."""
        self._closed = True
        self._waiting = FitQueue()
        self._drop()

    def tick(self) -> None:
        """Show the fit of the object in the view, if it is known; call once a frame."""
        key = self._key
        if key != self._shown_key:
            self._shown_key = key
            self._waiting = replace(self._waiting, chosen=None)
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
        note = _describe(problems, len(images))
        if note:
            self._jobs.messages.notify(note, MessageKind.NOTE if sources else MessageKind.PROBLEM)
        sources = tuple(map(self._copies.keep, sources))
        if len(sources) > MOST_PHOTOS:
            self.fit_each(sources)
            return
        shown = FitHistory() if self.running and self._viewport.following else self.shown
        self.fit(*sources)
        if sources:
            self._offer(sources, shown, note)

    def _offer(self, sources: tuple[PhotoSource, ...], shown: FitHistory, note: str) -> None:
        """Offer the other meaning of dropped photos: an object each, or another photo of the finished object shown.

        Args:
            note: words about files that are no photos, for the same message.
        """
        name = shown.name
        if len(sources) > 1:
            text = f"{len(sources)} photos are fitted as one object"
            button = Button("An object each", partial(self._instead, sources, partial(self.fit_each, sources)))
        elif shown.photos and len(shown.sources) < MOST_PHOTOS:
            text = f"{sources[0].name} is fitted as a new object"
            add = partial(self._fit_more, shown, sources[0])
            button = Button("Another photo of", partial(self._instead, sources, add), name)
        else:
            return
        text = ". ".join(filter(None, (text, note)))
        self._jobs.messages.notify(text, MessageKind.NOTE, buttons=(button,), relevant=partial(self._awaits, sources))

    def _instead(self, sources: tuple[PhotoSource, ...], fit: Callable[[], None]) -> None:
        """Withdraw the fit of photos, and run another."""
        for request in self.pending:
            if request.history.sources == sources:
                self.withdraw(request.history.sources)
        fit()

    def _awaits(self, sources: tuple[PhotoSource, ...]) -> bool:
        return any(request.history.sources == sources and not request.problem for request in self.pending)

    def ask_first(self, request: FitRequest) -> None:
        """Show a request's question before the others, and in place of a followed fit."""
        self._viewport.unfollow()
        self._waiting = self._waiting.asking_first(request)

    def fit(self, *sources: PhotoSource, model: str = "", confirmed: Confirmed = _NONE) -> None:
        """Begin or queue a fit of photos, if any, dropping questions about them.

        Args:
            model: the model's fingerprint; empty chooses by the category of the first photo.
        """
        self._waiting = self._waiting.without_questions(sources)
        if sources:
            self._begin(FitRequest(FitHistory(sources, model=model)), confirmed)

    def fit_each(self, sources: tuple[PhotoSource, ...]) -> None:
        """Fit an object to each photo, one after the other."""
        first, *later = sources
        self.fit(first)
        requests = tuple(FitRequest(FitHistory((source,))) for source in later)
        self._waiting = self._waiting.without_questions(tuple(later)).joined(FitQueue(requests))
        if later:
            text = f"{len(sources)} photos show an object each: they are fitted one after the other"
            self._jobs.messages.notify(text, MessageKind.NOTE)

    def add_photo(self, history: FitHistory, path: Path, side: Side | None = None) -> None:
        """Refine an object with another photo, and the side that it shows, if known."""
        self._fit_more(history, self._copies.keep(PhotoSource(path, side=side)))

    def _fit_more(self, history: FitHistory, source: PhotoSource) -> None:
        self._refine(history, (), source)

    def take_out(self, history: FitHistory, number: int) -> None:
        """Refine an object without one of its photos."""
        self._refine(history, (number,))

    def _refine(self, earlier: FitHistory, without: tuple[int, ...], *added: PhotoSource) -> None:
        """Fit photos from the earlier result, without a search if it can resume; those it left out are dropped."""
        left_out = earlier.last.left_out if earlier.last else ()
        history = earlier.without_photos(*without, *left_out)
        initial = earlier.resume_point and earlier.resume_point.without((*without, *left_out))
        if not history.sources:  # the last photo that was not left out is taken out
            history = earlier.without_photos(*without)
            initial = None
        history = replace(history, sources=(*history.sources, *added))
        self._waiting = self._waiting.without_questions(history.sources)
        self._begin(FitRequest(history, initial, answered=len(history.photos)))

    def fit_again(self, history: FitHistory) -> None:
        """Fit the photos of a history from the beginning, without questions about those it has read."""
        self._begin(FitRequest(replace(history, steps=()), answered=len(history.photos)))

    def withdraw(self, sources: tuple[PhotoSource, ...]) -> None:
        """Cancel the fit of exactly these photos, waiting or running, without a result."""
        self.forget(sources)
        if self.request and self.history.sources is sources:
            self._drop()
            self.view.show(self._before)
            self._next()

    def refit(self, model: Model | None = None) -> None:
        """Fit the photos of the object in the view again, from the beginning.

        Args:
            model: None keeps the model of the last fit.
        """
        history = replace(self.shown, photos=(), model=model.fingerprint) if model else self.shown
        self._begin(FitRequest(replace(history, steps=()), answered=len(history.sources)))

    def choose(self, sources: tuple[PhotoSource, ...], index: int, number: int, model: str = "") -> None:
        """Fit another detected object of a photo, by its number; the most prominent one is 0."""
        chosen = sources[index]._replace(hints=Hints(object=number))
        self.fit(*sources[:index], chosen, *sources[index + 1 :], model=model)

    # Photos that a person looks at first

    def answer(self, question: Question, model: str = "") -> None:
        """Fit a photo in question with its cut-out.

        Args:
            model: the model's fingerprint; empty takes the question's.
        """
        history = question.request.history
        model = model or question.model
        photos = history.photos if model == history.model else ()
        resume_from = question.request.resume_from if photos else None
        request = FitRequest(FitHistory(history.sources, photos, model=model), resume_from, question.number + 1)
        cut = question.cut
        preview = question.preview
        confirmed = dict(self._waiting.confirmed)
        if cut and preview:
            confirmed[question.source] = lambda: (cut, preview)
        self.forget(history.sources)
        self._begin(request, confirmed)

    def try_again(self, request: FitRequest, history: FitHistory | None = None) -> None:
        """Repeat a failed fit with the photos, cut-outs and answers that it had, or with another history."""
        self.forget(request.history.sources)
        self._begin(request._replace(history=history or request.history, problem=""), self._waiting.confirmed)

    def needs_file(self, question: Question) -> bool:
        """Return whether a fit reads the file of the photo in question; a confirmed cut-out needs none."""
        return question.is_unread and question.source not in self._waiting.confirmed

    def relocate(self, question: Question, path: Path) -> None:
        """Repeat a failed fit with another file for the photo in question."""
        history = question.request.history
        moved = self._copies.keep(question.source._replace(path=path, copy=None))
        sources = tuple(moved if source is question.source else source for source in history.sources)
        self.try_again(question.request, replace(history, sources=sources))

    def leave(self, question: Question) -> None:
        """Leave a photo in question out, and fit its object's other photos; leave all of a failed fit out."""
        history = question.request.history
        self.forget(history.sources)
        if question.is_failed:
            return
        if sources := tuple(source for source in history.sources if source is not question.source):
            self._begin(FitRequest(replace(history, sources=sources), answered=question.number))

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue the shown fit from a hypothesis, by default the best one of the newest step."""
        if initial := hypothesis or self.history.resume_point:
            self._run(FitRequest(self.history, initial))

    def resume_from_view(self) -> None:
        """Continue the shown fit from the view's codes and, for the selected photo, its direction."""
        if initial := self.history.resume_point:
            scene = self._editor.scene
            cameras = list(initial.cameras)
            index = self.history.photo_index  # its camera keeps its distance: the view's is not the photo's
            cameras[index] = replace(cameras[index], azimuth=scene.camera.azimuth, elevation=scene.camera.elevation)
            self.resume(replace(initial, cameras=tuple(cameras), instance=scene.instance))

    def stop(self) -> None:
        """End the running fit with its newest step as the result, and begin the next."""
        if self.running:
            self._jobs.cancel("fit")
            if self.history.steps:
                *before, last = self.history.steps
                self.view.history = replace(self.history, steps=(*before, self._with_detail(last)))
            self._finish()
            self._next()

    def forget(self, sources: tuple[PhotoSource, ...]) -> None:
        """Remove the request of these photos from queue and questions."""
        self._waiting = self._waiting.without(sources)

    def remove_failed(self) -> None:
        """Remove all failed fits, and offer to undo that."""
        failed = tuple(question for question in self.questions if question.is_failed)
        for question in failed:
            self.forget(question.request.history.sources)
        undo = Button("Undo", partial(self.take_over, FitQueue(questions=failed)))
        text = f"Removed {len(failed)} that could not be fitted"
        self._jobs.messages.notify(text, buttons=(undo,), relevant=lambda: not self._closed)

    def follow(self) -> None:
        """Let the view follow the running fit from the photo's camera, so that its result is shown."""
        if self.running and not self.results.checking and self.history.last:
            self._viewport.follow()

    def rename(self, name: str, to: str) -> None:
        """Follow the renaming of a result."""
        self.results.rename(name, to)

    # Progress

    def _begin(self, request: FitRequest, confirmed: Confirmed = _NONE) -> None:
        """Run a request now, or queue it."""
        unfinished = {source for waiting in self.pending for source in waiting.history.sources}
        kept = {source: cut for source, cut in self._waiting.confirmed.items() if source in unfinished}
        kept |= {source: confirmed[source] for source in request.history.sources if source in confirmed}
        self._waiting = replace(self._waiting, confirmed=kept)
        if not self.running:
            self._run(request)
            return
        self._waiting = self._waiting.joined(FitQueue((request,)))

    def _next(self) -> None:
        """Run the next request without following it: a person may be editing the last result."""
        if self.queue and not self.running:
            request, *later = self.queue
            self._waiting = replace(self._waiting, requests=tuple(later))
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
            self._waiting = replace(self._waiting, chosen=None)
            self._viewport.follow()
        self._submit(request)

    def _submit(self, request: FitRequest) -> None:
        """Read the video of a request or, of photos, run the fit."""
        if is_of_clip(request, self._waiting.confirmed):
            frames = partial(read_frames, self._jobs.backend, request, self._copies.keep)
            self._jobs.submit(Job("fit", frames, self._receive_frames, self._read, weight=FIT_WEIGHT))
            return
        settings = self.options.settings(request.refines)
        stream = partial(fit_stream, self._jobs, self._editor.model, request, settings, self._waiting.confirmed)
        self._jobs.submit(Job("fit", stream, self._receive, self._ended, weight=FIT_WEIGHT))

    def _receive_frames(self, value: ReadFraction | ClipRequest) -> None:
        if isinstance(value, ReadFraction):
            self.view.read_fraction = value.value
            return
        self.request = value.request
        self.view.show(value.request.history)
        self._waiting = replace(self._waiting, confirmed={**self._waiting.confirmed, **value.confirmed})
        if value.note:
            name = value.request.history.sources[0].name
            self._jobs.messages.notify(f"{name}: {value.note}", MessageKind.NOTE)

    def _read(self, error: Exception | None) -> None:
        """Fit the frames of a video that was read."""
        if error or self.request is None:
            self._ended(error)
        else:
            self._submit(self.request)

    def _receive(self, value: Model | Doubt | CutOutPreview | FittedPhoto | FitStep) -> None:
        if isinstance(value, Model):
            self.view.history = replace(self.history, model=value.fingerprint)
        elif isinstance(value, Doubt):
            self._ask(value)
        elif isinstance(value, CutOutPreview):
            self.view.preview = value
        elif isinstance(value, FittedPhoto):
            self.view.history = replace(self.history, photos=(*self.history.photos, value))
            if value.photo.note:
                self._jobs.messages.notify(f"{value.source.name}: {value.photo.note}", MessageKind.NOTE)
        else:
            if value.restart and not self.results.checking and self.history.last:
                self._hand_over(self.history.last)
            self.view.add_step(value)

    def _ask(self, doubt: Doubt) -> None:
        """Turn the running request into a question, and run the next."""
        (request,) = self._unfinished
        self._drop()
        self.view.show(self._before)
        model = doubt.model.fingerprint if doubt.model else ""
        question = Question(request, doubt.words, doubt.cut, doubt.preview, model, doubt.neither)
        self._waiting = self._waiting.joined(FitQueue(questions=(question,)))
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
            self._waiting = self._waiting.joined(FitQueue(questions=(Question.of_failure(failed, preview),)))
            if self._viewport.following:
                self._waiting = replace(self._waiting, chosen=failed)
        self._drop()
        if not is_usable:
            self.view.show(self._before)

    def _finish(self) -> None:
        last = self.history.last
        checking = self.results.checking
        if last is None:
            self._jobs.messages.notify("Stopped before there was a result", MessageKind.NOTE)
        elif checking:
            self._keep(checking.name)
            if self.results.improve(checking, self._fitted(last), self.view.camera_of(last)):
                self._jobs.messages.notify(f"{checking.name}: a better viewpoint was found")
        else:
            self._add(last)
            self._offer_left_out(tuple(self.history.sources[number] for number in last.left_out))
        self.request = self.results.checking = None
        self._viewport.unfollow()

    def _offer_left_out(self, sources: tuple[PhotoSource, ...]) -> None:
        """Name the photos that a fit left out, with a button to fit an object to each."""
        if sources:
            text = f"Left out, as another object: {', '.join(source.name for source in sources)}"
            button = Button("Fit by itself" if len(sources) == 1 else "Fit each", partial(self.fit_each, sources))
            self._jobs.messages.notify(text, MessageKind.NOTE, buttons=(button,), relevant=lambda: not self._closed)

    def _hand_over(self, first: FitStep) -> None:
        """Add the first search's result while a second search checks it."""
        self.results.checking = self._add(first)
        self._viewport.unfollow()

    def _add(self, step: FitStep) -> Ready:
        """Add a step's result to the objects, and keep its fit."""
        ready = self.results.add(self._fitted(step), self.view.camera_of(step))
        self._keep(ready.name)
        return ready

    def _keep(self, name: str) -> None:
        """Keep the shown fit as that of an object."""
        self.view.keep(self._editor.objects[name].key)

    def _with_detail(self, step: FitStep) -> FitStep:
        """Return a stopped fit's step with photo detail, which only full fits end with."""
        if step.instance.detail or not step.hypotheses or not self.history.can_resume(step.hypotheses[0]):
            return step
        return with_photo_detail([fitted.photo for fitted in self.history.photos], step)

    def _fitted(self, step: FitStep) -> EditableObject:
        return EditableObject(self.history.name, step.instance, True, step.confidence)


def _describe(problems: dict[Path, ValueError], count: int) -> str:
    """Return a sentence about files that are no photos among ``count`` files; "" for none."""
    if not problems:
        return ""
    if count == 1:
        return f"Cannot fit this image: {error_text(*problems.values())}"
    names = ", ".join(printable(path.name) for path in [*problems][:_NAMED]) + ", …" * (len(problems) > _NAMED)
    return f"{len(problems)} of {count} are no photos: {names}"
