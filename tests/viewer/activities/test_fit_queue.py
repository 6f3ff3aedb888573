"""The queue of fits as a value."""

from pathlib import Path

import pytest

from viewer.activities.fit_queue import FitQueue
from viewer.values.fit_history import FitHistory, FitRequest, PhotoSource, Question


def request(name: str, problem: str = "") -> FitRequest:
    return FitRequest(FitHistory((PhotoSource(Path(name)),)), problem=problem)


@pytest.fixture
def queue() -> FitQueue:
    questions = (Question.of_failure(request("a.png", "no memory")), Question(request("b.png"), "Which one?"))
    return FitQueue((request("c.png"),), questions)


def test_a_failed_fit_is_asked_once_it_is_chosen(queue: FitQueue) -> None:
    failed, asked = queue.questions
    assert queue.question is asked
    assert queue.asking_first(failed.request).question is failed


def test_questions_set_aside_are_asked_once_they_are_chosen(queue: FitQueue) -> None:
    later = queue.asking_later()
    assert later.question is None and later.questions == queue.questions
    reopened = later.asking_first(queue.questions[1].request)
    assert reopened.question is reopened.questions[0] is queue.questions[1]


def test_requests_are_removed_by_identity_and_questions_by_path(queue: FitQueue) -> None:
    assert queue.without(request("c.png").history.sources).requests == queue.requests
    assert queue.without(queue.requests[0].history.sources).requests == ()
    assert queue.without(queue.questions[0].request.history.sources).questions == queue.questions[1:]
    assert queue.without_questions((PhotoSource(Path("b.png")),)).questions == queue.questions[:1]
    assert queue.joined(queue).pending == (*queue.pending[:2], *queue.pending[:2], *queue.requests * 2)
