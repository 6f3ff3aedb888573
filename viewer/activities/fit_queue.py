"""The requests for fits that wait, as a value."""

from dataclasses import dataclass, field, replace

from viewer.activities.fit_stream import Confirmed
from viewer.values.fit_history import FitRequest, PhotoSource, Question


@dataclass(frozen=True, eq=False)
class FitQueue:
    """Requests that wait for their turn, or for the answer to a question about a photo.

    A person's answer is awaited while the next fits run. A failed fit is a question too: it keeps its photos and
    confirmed cut-outs until it is tried again.
    """

    requests: tuple[FitRequest, ...] = ()  # the next first
    questions: tuple[Question, ...] = ()  # the one chosen last first, then the oldest
    confirmed: Confirmed = field(default_factory=dict)  # cut-outs of unfinished requests
    chosen: FitRequest | None = None  # request whose question was chosen last
    set_aside: tuple[FitRequest, ...] = ()  # requests whose questions gave way to a chosen object

    @property
    def question(self) -> Question | None:
        """The question to show, if any.

        A failed fit is not shown before it was chosen, and no question after an object was, until its tile is.
        """
        for question in self.questions:
            hidden = question.is_failed or any(question.request is request for request in self.set_aside)
            if not hidden or question.request is self.chosen:
                return question
        return None

    @property
    def pending(self) -> tuple[FitRequest, ...]:
        """All requests; those in question first."""
        return (*(question.request for question in self.questions), *self.requests)

    def joined(self, later: "FitQueue") -> "FitQueue":
        """Return the queue with the requests, questions and cut-outs of a later one."""
        confirmed = {**later.confirmed, **self.confirmed}
        requests = (*self.requests, *later.requests)
        return replace(self, requests=requests, questions=(*self.questions, *later.questions), confirmed=confirmed)

    def asking_first(self, request: FitRequest) -> "FitQueue":
        """Return the queue with a request's question chosen, before the others."""
        questions = tuple(sorted(self.questions, key=lambda question: question.request is not request))
        return replace(self, questions=questions, chosen=request)

    def asking_later(self) -> "FitQueue":
        """Return the queue with its questions set aside, for an object that a person chose; their tiles stay."""
        return replace(self, chosen=None, set_aside=tuple(question.request for question in self.questions))

    def without(self, sources: tuple[PhotoSource, ...]) -> "FitQueue":
        """Return the queue without the request of exactly these photos, and without its question."""
        requests = tuple(request for request in self.requests if request.history.sources is not sources)
        questions = tuple(question for question in self.questions if question.request.history.sources is not sources)
        return replace(self, requests=requests, questions=questions)

    def without_questions(self, sources: tuple[PhotoSource, ...]) -> "FitQueue":
        """Return the queue without questions about any of these photos."""
        paths = {source.path for source in sources}
        return replace(self, questions=tuple(item for item in self.questions if item.source.path not in paths))
