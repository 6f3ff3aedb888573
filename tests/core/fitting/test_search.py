"""Restarts of a search and the better of two."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from core.fitting import search
from core.fitting.descent import refine
from core.fitting.fit import FitJob, fit
from core.fitting.hypotheses import DivergedError
from core.fitting.initial import initial_hypotheses
from core.fitting.search import SearchResult, better_of
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import SHORT, problem_of, seeded
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit runs fits with checks


def stool(model: Model, posed: bool = False) -> Photo:
    camera = model.camera(0.9, 0.3)
    photo = photo_of(model[0], camera)
    return replace(photo, camera=camera) if posed else photo


# Restarts


def test_a_doubtful_camera_restarts_the_search(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    job = FitJob((stool(tiny),), SHORT)
    once = list(fit(tiny, job))
    twice = replace(job, settings=replace(SHORT, max_restarts=1))
    monkeypatch.setattr(search, "RESTART_BELOW", 0.0)
    assert [step.loss for step in fit(tiny, twice)] == [step.loss for step in once]
    monkeypatch.setattr(search, "RESTART_BELOW", 1.1)
    steps = list(fit(tiny, twice))
    first = steps[: len(once)]
    second = steps[len(once) :]
    assert [step.loss for step in first] == [step.loss for step in once]
    assert first[-1].steps > first[-1].step
    for step in [first[-1], *second[:-1]]:  # a fit that is stopped has the first result, and all that is known of it
        state = (step.loss, step.cameras, step.runner_up and step.runner_up.loss, step.margin, step.uncertainty)
        assert state == (
            *(once[-1].loss, once[-1].cameras, once[-1].runner_up and once[-1].runner_up.loss),
            *(once[-1].margin, once[-1].uncertainty),
        )
    assert second[-1].loss <= first[-1].loss
    assert second[0].active == once[0].active
    assert len(second[0].hypotheses) == once[0].active + 1
    assert [step.restart for step in steps] == [False] * len(first) + [True] * len(second)
    assert [step.step for step in steps] == list(range(1, len(steps) + 1))
    assert steps[-1].step <= steps[-1].steps
    assert second[-1].active == 1
    assert second[-1].runner_up is not None
    assert len(list(fit(tiny, replace(twice, resume_from=steps[-1].hypotheses[0])))) <= SHORT.steps


@pytest.mark.parametrize("kind", ["posed", "several"])
def test_known_or_several_cameras_are_never_restarted(tiny: Model, monkeypatch: pytest.MonkeyPatch, kind: str):
    photos = {"posed": (stool(tiny, posed=True),), "several": (stool(tiny), stool(tiny))}[kind]
    monkeypatch.setattr(search, "RESTART_BELOW", 1.1)
    once, twice = (list(fit(tiny, FitJob(photos, replace(SHORT, max_restarts=most)))) for most in (0, 1))
    assert [step.loss for step in once] == [step.loss for step in twice]
    assert not any(step.restart for step in twice)


def test_a_diverged_restart_keeps_the_first_result(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    job = FitJob((stool(tiny),), SHORT)
    *_, once = fit(tiny, job)
    searches = 0

    def diverging(*arguments: object) -> Iterator:
        nonlocal searches
        searches += 1
        if searches > 1:
            raise DivergedError
        yield from refine(*arguments)

    monkeypatch.setattr(search, "RESTART_BELOW", 1.1)
    monkeypatch.setattr(search, "refine", diverging)
    *_, final_step = fit(tiny, replace(job, settings=replace(SHORT, max_restarts=1)))
    assert searches == 2
    assert final_step.restart
    assert (final_step.loss, final_step.margin) == (once.loss, once.margin)


def test_the_better_of_two_searches_gets_the_smaller_margin(tiny: Model):
    problem = problem_of(tiny, stool(tiny), settings=SHORT)
    start = initial_hypotheses(problem, 1, seeded())

    def result(azimuth: float, loss: float, margin: float) -> SearchResult:
        parameters = start.parameters._replace(angles=torch.tensor([[[azimuth, 0.3]]]))
        winner = replace(start, parameters=parameters, loss=torch.tensor([loss]))
        return SearchResult(winner, winner, margin, loss)

    clear = result(0.9, 1.0, 2.0)
    doubtful = result(0.9, 2.0, 0.1)
    behind = result(-2.0, 1.5, 2.0)
    better = better_of(problem, doubtful, clear)  # they agree
    assert (better.winner, better.runner_up, better.margin) == (clear.winner, doubtful.runner_up, doubtful.margin)
    better = better_of(problem, behind, clear)
    assert (better.winner, better.uncertainty) == (clear.winner, clear.uncertainty)
    assert torch.equal(better.runner_up.parameters.angles, behind.winner.parameters.angles)
    assert better.margin == pytest.approx(math.log(1.5))
