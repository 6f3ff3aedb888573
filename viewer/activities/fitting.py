"""The running fit, the queue of fits, and the questions about photos."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from core.fitting.fit import FitStep, Hypothesis
from core.fitting.photo_views import with_photo_detail
from core.models.model import Model
from core.models.photo_detail import MAX_PHOTOS
from core.photos.segmentation import Hints
from viewer.activities.fit_results import FitResults
from viewer.activities.fit_stream import Confirmed, Doubt, FitOptions, fit_stream
from viewer.activities.fit_view import FitView
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.services.jobs import FIT_SHARE, Jobs
from viewer.services.messages import Button, MessageKind, error_text
from viewer.services.photo_copies import PhotoCopies
from viewer.services.worker import Job
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource, Question, Ready, photo_sources
from viewer.values.objects import EditableObject
from viewer.values.printable import printable
from viewer.values.seen_cut_out import SeenCutOut

_FITS = 8  # finished fits whose histories are kept
_NAMED = 3  # files that a message names
_NONE: Confirmed = {}


class Unfinished(NamedTuple):
    """Fits that a new project takes over from the former one: waiting photos with their cut-outs."""

    queue: tuple[FitRequest, ...]
    questions: tuple[Question, ...]
    confirmed: Confirmed


class Fitting:
    """Runs one fit at a time and queues the others.

    A request about whose photo a person must decide waits in ``questions`` while the next fit begins; so does one
    that failed, with its photos and confirmed cut-outs, until it is tried again.
    """

    def __init__(
        self, jobs: Jobs, editor: Editor, viewport: Viewport, options: FitOptions, copies: PhotoCopies
    ) -> None:
        self._jobs, self._editor, self._viewport, self.options = jobs, editor, viewport, options
        self._copies = copies  # of photos, which may wait longer than their files exist
        self.view = FitView(editor, viewport, jobs.models)
        self.results = FitResults(editor, viewport)
        self.request: FitRequest | None = None  # the running fit's
        self.queue: tuple[FitRequest, ...] = ()  # the next first
        self.questions: tuple[Question, ...] = ()  # the one chosen last first, then the oldest
        self._chosen: FitRequest | None = None  # request whose question was chosen last
        self._set_aside: tuple[FitRequest, ...] = ()  # requests whose questions gave way to a chosen object
        self._confirmed = _NONE  # of unfinished requests
        self._shown_fit, self._fits = "", dict[str, FitHistory]()  # name of the shown fit's object; fits by name
        self._before = self.history  # the fit shown before the last one began
        self._name = ""  # object in the view
        editor.object_chosen.connect(self._set_questions_aside)

    @property
    def history(self) -> FitHistory:
        """The running fit, or the one shown last."""
        return self.view.history

    @property
    def shown(self) -> FitHistory:
        """The fit of the object in the view; empty if it was not made in this run."""
        if self.running and self._viewport.following:
            return self.history
        name = self._root
        newest = name == self._shown_fit and (not self.running or self.results.checking is not None)
        return self.history if newest else self._fits.get(name, FitHistory())

    @property
    def _root(self) -> str:
        """Name of the object in the view, of which its versions have the fit."""
        return self._editor.objects.root(self._editor.state.mix.a.shape)

    @property
    def question(self) -> Question | None:
        """The question to show; None while a fit is followed.

        A failed fit is not shown before it was chosen, and no question after an object was, until its tile is.
        """
        if self.running and self._viewport.following:
            return None
        return next((question for question in self.questions if self._is_asked(question)), None)

    def _is_asked(self, question: Question) -> bool:
        hidden = question.is_failed or any(question.request is request for request in self._set_aside)
        return not hidden or question.request is self._chosen

    def _set_questions_aside(self) -> None:
        """Make room for the object that a person chose; the tiles of the questions stay."""
        self._chosen, self._set_aside = None, tuple(question.request for question in self.questions)

    @property
    def running(self) -> bool:
        """True while a fit is running."""
        return self.request is not None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """Unfinished requests: the running fit, unless its preliminary result is there, questions and queue."""
        return (*self._unfinished, *(question.request for question in self.questions), *self.queue)

    @property
    def _unfinished(self) -> tuple[FitRequest, ...]:
        """The running fit as a request to restart it; empty if its preliminary result is there."""
        if self.request is None or self.results.checking:
            return ()
        history = replace(self.request.history, photos=self.history.photos, model=self.history.model)
        return (self.request._replace(history=history),)

    @property
    def unfinished(self) -> Unfinished:
        """All that a new project takes over: the running fit, which begins again, queue and questions."""
        return Unfinished((*self._unfinished, *self.queue), self.questions, self._confirmed)

    def take_over(self, unfinished: Unfinished) -> None:
        """Continue what another project left unfinished."""
        self._confirmed = {**unfinished.confirmed, **self._confirmed}
        self.queue = (*self.queue, *unfinished.queue)
        self.questions = (*self.questions, *unfinished.questions)
        self._next()

    def close(self) -> None:
        """Cancel the running fit, the queue and the questions."""
        self.queue, self.questions = (), ()
        self._drop()

    def tick(self) -> None:
        """Show the fit of the object in the view, if it was made in this run; call once a frame."""
        name = self._root
        if name != self._name:
            self._name, self._chosen = name, None
        if self.running or name == self._shown_fit or name not in self._fits:
            return
        self._shown_fit = name
        self.view.show(self._fits[name])

    def restore(self, history: FitHistory, pending: tuple[FitRequest, ...]) -> None:
        """Show a saved fit, unless another is shown, and continue unfinished requests; failed ones are questions."""
        if not self.history.sources:
            self.view.show(history)
            added, last = self._editor.objects.added, history.last
            if name := next((one.name for one in added if last and one.original == last.instance), ""):
                self._keep_fit(name)
        self.queue = (*self.queue, *(request for request in pending if not request.problem))
        self.questions = (*self.questions, *(_failure(request) for request in pending if request.problem))
        self._next()

    # What is fitted

    def start(self, *paths: Path) -> None:
        """Fit one object to image files; to more than an object keeps, an object to each."""
        sources, others = photo_sources(paths)
        if others:
            names = ", ".join(printable(path.name) for path in others[:_NAMED]) + ", …" * (len(others) > _NAMED)
            self._jobs.messages.notify(f"Left out {names}: no image", MessageKind.NOTE)
        sources = tuple(map(self._copies.keep, sources))
        if len(sources) > MAX_PHOTOS:
            self._fit_each(*sources)
        else:
            self.fit(*sources)

    def ask_first(self, request: FitRequest) -> None:
        """Show a request's question before the others, and in place of a followed fit."""
        self._viewport.unfollow()
        self._chosen = request
        self.questions = tuple(sorted(self.questions, key=lambda one: one.request is not request))

    def fit(self, *sources: PhotoSource, model: str = "", confirmed: Confirmed = _NONE) -> None:
        """Begin or queue a fit of photos, if any, dropping questions about them.

        Args:
            model: the model's fingerprint; empty chooses by the category of the first photo.
        """
        self._withdraw_questions(sources)
        if sources:
            self._begin(FitRequest(FitHistory(sources, model=model)), confirmed)

    def _fit_each(self, first: PhotoSource, *others: PhotoSource) -> None:
        """Begin or queue a fit of each photo."""
        self.fit(first)
        self._withdraw_questions(others)
        self.queue = (*self.queue, *(FitRequest(FitHistory((source,))) for source in others))
        text = f"{len(others) + 1} photos show an object each: they are fitted one after the other"
        self._jobs.messages.notify(text, MessageKind.NOTE)

    def _withdraw_questions(self, sources: tuple[PhotoSource, ...]) -> None:
        paths = {source.path for source in sources}
        self.questions = tuple(question for question in self.questions if question.source.path not in paths)

    def add_photo(self, history: FitHistory, path: Path) -> None:
        """Fit an object again with another photo."""
        self.fit(*history.sources, self._copies.keep(PhotoSource(path)), model=history.model)

    def refit(self, model: Model | None = None) -> None:
        """Fit the photos of the object in the view again, from the beginning.

        Args:
            model: None keeps the model of the last fit.
        """
        shown = self.shown
        photos = shown.photos if model is None else ()
        history = FitHistory(shown.sources, photos, model=model.fingerprint if model else shown.model)
        self._begin(FitRequest(replace(history, photo_index=shown.photo_index), answered=len(shown.sources)))

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
        history, model = question.request.history, model or question.model
        photos = history.photos if model == history.model else ()
        request = FitRequest(FitHistory(history.sources, photos, model=model), answered=question.number + 1)
        cut, seen, confirmed = question.cut, question.seen, dict(self._confirmed)
        if cut and seen:
            confirmed[question.source] = lambda: (cut, seen)
        self.forget(history.sources)
        self._begin(request, confirmed)

    def try_again(self, request: FitRequest, history: FitHistory | None = None) -> None:
        """Repeat a failed fit with the photos, cut-outs and answers that it had, or with another history."""
        again, confirmed = request._replace(history=history or request.history, problem=""), self._confirmed
        self.forget(request.history.sources)
        self._begin(again, confirmed)

    def needs_file(self, question: Question) -> bool:
        """Return whether a fit reads the file of the photo in question; a confirmed cut-out needs none."""
        return question.is_unread and question.source not in self._confirmed

    def relocate(self, question: Question, path: Path) -> None:
        """Repeat a failed fit with another file for the photo in question."""
        history = question.request.history
        moved = self._copies.keep(question.source._replace(path=path, copy=None))
        sources = tuple(moved if source is question.source else source for source in history.sources)
        self.try_again(question.request, replace(history, sources=sources))

    def leave(self, question: Question) -> None:
        """Leave a photo in question out, and fit the others of its object, if any; leave all of a failed fit out."""
        history = question.request.history
        self.forget(history.sources)
        if question.is_failed:
            return
        if others := tuple(source for source in history.sources if source is not question.source):
            self._begin(FitRequest(replace(history, sources=others), answered=question.number))

    def resume(self, hypothesis: Hypothesis | None = None) -> None:
        """Continue the shown fit from a hypothesis, by default the best one of the newest step."""
        initial = hypothesis or self.resume_point
        if initial is not None:
            self._run(FitRequest(self.history, initial))

    def resume_from_view(self) -> None:
        """Continue the shown fit from the view's codes and, for the selected photo, its direction."""
        if initial := self.resume_point:
            scene, cameras, index = self._editor.scene, list(initial.cameras), self.history.photo_index
            seen = scene.camera  # the object's size in the view is not its size in the photo
            cameras[index] = replace(cameras[index], azimuth=seen.azimuth, elevation=seen.elevation)
            self.resume(replace(initial, cameras=tuple(cameras), instance=scene.instance))

    @property
    def resume_point(self) -> Hypothesis | None:
        """The best hypothesis of the newest step; None if the fit cannot be resumed yet."""
        step = self.history.last
        best = step.hypotheses[0] if step and step.hypotheses else None
        return best if best and self.can_resume(best) else None

    def can_resume(self, hypothesis: Hypothesis) -> bool:
        """Return whether the shown fit can continue from a hypothesis, which needs a camera per photo."""
        return len(hypothesis.cameras) == len(self.history.photos)

    def stop(self) -> None:
        """End the running fit with its newest step as the result, and begin the next."""
        if self.running:
            self._jobs.cancel("fit")
            if self.history.steps:
                *before, last = self.history.steps
                self.view.history = replace(self.history, steps=(*before, self._with_detail(last)))
            self._finish("Stopped after")
            self._next()

    def forget(self, sources: tuple[PhotoSource, ...]) -> None:
        """Remove the request of these photos from queue and questions."""
        self.queue = tuple(one for one in self.queue if one.history.sources is not sources)
        self.questions = tuple(one for one in self.questions if one.request.history.sources is not sources)

    def follow(self) -> None:
        """Let the view follow the running fit from the photo's camera, so that its result is shown."""
        if self.running and not self.results.checking and self.history.last:
            self._viewport.follow()

    def rename(self, name: str, to: str) -> None:
        """Follow the renaming of a result."""
        self.results.rename(name, to)
        self._fits = {to if one == name else one: fit for one, fit in self._fits.items()}
        self._shown_fit = to if self._shown_fit == name else self._shown_fit

    def _keep_fit(self, name: str) -> None:
        self._fits[name], self._shown_fit = self.history, name
        while len(self._fits) > _FITS:
            del self._fits[next(iter(self._fits))]

    # Progress

    def _begin(self, request: FitRequest, confirmed: Confirmed = _NONE) -> None:
        """Run a request now, or queue it."""
        unfinished = {source for one in self.pending for source in one.history.sources}
        kept = {source: cut for source, cut in self._confirmed.items() if source in unfinished}
        self._confirmed = kept | {one: confirmed[one] for one in request.history.sources if one in confirmed}
        if not self.running:
            self._run(request)
            return
        self.queue = (*self.queue, request)
        self._jobs.messages.notify(f"{request.history.name} waits for the photo before it", MessageKind.NOTE)

    def _next(self) -> None:
        """Run the next request without following it: a person may be editing the last result."""
        if self.queue and not self.running:
            request, self.queue = self.queue[0], self.queue[1:]
            self._run(request, follow=False)

    def _drop(self) -> None:
        """Cancel the running fit without a result."""
        self._jobs.cancel("fit")
        self._viewport.unfollow()
        self.request = self.results.checking = None

    def _run(self, request: FitRequest, follow: bool = True) -> None:
        self._before = self.history
        history, resume_from = request.history, request.resume_from
        self._drop()
        self.view.show(history)
        self.request = request
        if follow:
            self._chosen = None
            self._viewport.follow()
        settings = self.options.settings(resume_from is not None)
        stream = partial(fit_stream, self._jobs, self._editor.model, request, settings, self._confirmed)
        self._jobs.submit(Job("fit", stream, self._receive, self._ended, share=FIT_SHARE))

    def _receive(self, value: Model | Doubt | SeenCutOut | FittedPhoto | FitStep) -> None:
        if isinstance(value, Model):
            self.view.history = replace(self.history, model=value.fingerprint)
        elif isinstance(value, Doubt):
            self._ask(value)
        elif isinstance(value, SeenCutOut):
            self.view.seen = value
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
        assert self.request is not None
        history = replace(self.request.history, photos=self.history.photos, model=self.history.model)
        request = self.request._replace(history=history)
        self._drop()
        self.view.show(self._before)
        model = doubt.model.fingerprint if doubt.model else ""
        question = Question(request, doubt.words, doubt.cut, doubt.seen, model, doubt.neither)
        self.questions = (*self.questions, question)
        self._next()

    def _ended(self, error: Exception | None) -> None:
        if error is None:
            self._finish("Fitted in")
        else:
            self._fail(error)
        self._next()

    def _fail(self, error: Exception) -> None:
        """Report an error and, unless the object can be used already, keep the request to try it again."""
        self._jobs.messages.report("Cannot fit this image", error)
        seen = self.view.seen or (self.history.photo.seen if self.history.photo else None)
        followed, usable = self._viewport.following, self.results.checking
        for request in self._unfinished:
            failed = request._replace(problem=error_text(error))
            self.questions = (*self.questions, _failure(failed, seen))
            self._chosen = failed if followed else self._chosen
        self._drop()
        if not usable:
            self.view.show(self._before)

    def _finish(self, how: str) -> None:
        last, checking = self.history.last, self.results.checking
        if last is None:
            self._jobs.messages.notify("Stopped before there was a result", MessageKind.NOTE)
        elif checking:
            self._keep_fit(checking.name)
            better = self.results.improve(checking, self._fitted(last), self.view.camera_of(last))
            verdict = "a better viewpoint was found" if better else "the viewpoint stays"
            self._tell(f"{checking.name} was checked from other sides: {verdict}", checking)
        else:
            found = self._add(last)
            self._keep_fit(found.name)
            self._tell(f"{how} {last.seconds:.0f} s: {found.name}", found)
        self.request = self.results.checking = None
        self._viewport.unfollow()

    def _hand_over(self, first: FitStep) -> None:
        """Add the first search's result while a second search checks it."""
        found = self.results.checking = self._add(first)
        self._keep_fit(found.name)
        self._viewport.unfollow()
        self._tell(f"{found.name} can be used; it is being checked from other sides", found)

    def _add(self, step: FitStep) -> Ready:
        return self.results.add(self._fitted(step), self.view.camera_of(step))

    def _tell(self, text: str, found: Ready) -> None:
        """Report a result, with a button to show it if something else is being edited."""
        show = Button("Show", lambda: self.results.show(found.name), found.name)
        unseen = self.results.unseen
        buttons = (show,) if found.name in unseen else ()
        self._jobs.messages.notify(text, buttons=buttons, relevant=lambda: not buttons or found.name in unseen)

    def _with_detail(self, step: FitStep) -> FitStep:
        """Return a stopped fit's step with photo detail, which only full fits end with."""
        if step.instance.detail or not step.hypotheses or not self.can_resume(step.hypotheses[0]):
            return step
        return with_photo_detail([fitted.photo for fitted in self.history.photos], step)

    def _fitted(self, step: FitStep) -> EditableObject:
        return EditableObject(self.history.name, step.instance, True, step.confidence)


def _failure(request: FitRequest, seen: SeenCutOut | None = None) -> Question:
    """Return the question whether to try a failed fit again."""
    return Question(request, f"Cannot fit this photo: {request.problem}", seen=seen, model=request.history.model)
