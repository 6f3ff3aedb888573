"""The answers to questions about photos, which a person looks at before they are fitted."""

from dataclasses import replace
from pathlib import Path

from core.photos.detector import Box
from core.photos.segmentation import Hints
from viewer.activities.fitting import Fitting
from viewer.store.photo_copies import PhotoCopies
from viewer.values.fit_history import FitHistory, FitRequest, PhotoSource, Question


class Answers:
    """Continues the fits of photos in question, as a person answers."""

    def __init__(self, fitting: Fitting, copies: PhotoCopies) -> None:
        self._fitting = fitting
        self._copies = copies

    def answer(self, question: Question, model: str = "") -> None:
        """Fit a photo in question with its cut-out; an empty ``model`` (fingerprint) takes the question's."""
        history = question.request.history
        model = model or question.model
        photos = history.photos if model == history.model else ()
        resume_from = question.request.resume_from if photos else None
        request = FitRequest(FitHistory(history.sources, photos, model=model), resume_from, question.number + 1)
        cut = question.cut
        preview = question.preview
        confirmed = dict(self._fitting.waiting.confirmed)
        if cut and preview:
            confirmed[question.source] = lambda: (cut, preview)
        self._fitting.forget(history.sources)
        self._fitting.begin(request, confirmed)

    def try_again(self, request: FitRequest, history: FitHistory | None = None) -> None:
        """Repeat a failed fit with the photos, cut-outs and answers that it had, or with another history."""
        self._fitting.forget(request.history.sources)
        repeated = request._replace(history=history or request.history, problem="")
        self._fitting.begin(repeated, self._fitting.waiting.confirmed)

    def needs_file(self, question: Question) -> bool:
        """Return whether a fit reads the file of the photo in question; a confirmed cut-out needs none."""
        return question.is_unread and question.source not in self._fitting.waiting.confirmed

    def relocate(self, question: Question, path: Path) -> None:
        """Repeat a failed fit with another file for the photo in question."""
        history = question.request.history
        moved = self._copies.keep(question.source._replace(path=path, copy=None))
        sources = tuple(moved if source is question.source else source for source in history.sources)
        self.try_again(question.request, replace(history, sources=sources))

    def leave(self, question: Question) -> None:
        """Leave a photo in question out, and fit its object's other photos; leave all of a failed fit out."""
        history = question.request.history
        self._fitting.forget(history.sources)
        if question.is_failed:
            return
        if sources := tuple(source for source in history.sources if source is not question.source):
            self._fitting.begin(FitRequest(replace(history, sources=sources), answered=question.number))

    def choose(self, sources: tuple[PhotoSource, ...], index: int, box: Box, model: str = "") -> None:
        """Fit the object in a box of a photo."""
        source = sources[index]._replace(hints=Hints(box=box))
        self._fitting.fit(*sources[:index], source, *sources[index + 1 :], model=model)
