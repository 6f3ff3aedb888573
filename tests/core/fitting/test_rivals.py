"""Rivals of a camera that is right, and of one that is wrong."""

import math
from dataclasses import replace

import pytest
import torch

from core.fitting import search
from core.fitting.descent import score
from core.fitting.fit import FitJob, fit
from core.fitting.hypotheses import HypothesisBatch
from core.fitting.initial import resume_from
from core.fitting.problem import Problem
from core.fitting.rivals import optimise_rivals, rival_hypotheses
from core.fitting.schedule import RIVAL_SECTORS, build_schedule
from core.fitting.settings import ALL_COMPONENTS
from core.fitting.steps import FitStep
from core.metrics import rotation_error
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import QUICK, problem_of, seeded
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit runs fits with checks
AZIMUTH, ELEVATION = 1.2, 0.3


@pytest.fixture(scope="module")
def photo(tiny: Model) -> Photo:
    return photo_of(tiny[0], tiny.camera(AZIMUTH, ELEVATION))


@pytest.fixture(scope="module")
def fitted(tiny: Model, photo: Photo) -> FitStep:
    *_, step = fit(tiny, FitJob((photo,), replace(QUICK, free_steps=0)))
    return step


def scored_winner(problem: Problem, step: FitStep, turn: float = 0.0) -> HypothesisBatch:
    """The result of a fit, its camera turned about the vertical."""
    hypothesis = step.hypotheses[0]
    camera = replace(hypothesis.cameras[0], azimuth=hypothesis.cameras[0].azimuth + turn)
    turned = replace(hypothesis, cameras=(camera,))
    return score(problem, resume_from(problem.model, problem.photos, problem.cameras, turned, problem.spaces), 0.2)


def test_rivals_start_in_every_other_sector_with_both_codes(tiny: Model, photo: Photo, fitted: FitStep):
    problem = problem_of(tiny, photo)
    winner = scored_winner(problem, fitted)
    rivals = rival_hypotheses(problem, winner)
    turns = (rivals.parameters.angles[:, 0, 0] - winner.parameters.angles[0, 0, 0]) * RIVAL_SECTORS / (2 * math.pi)
    assert turns.round().tolist() == [*range(1, RIVAL_SECTORS)] * 2
    with_codes, mean = rivals.parameters.shape.unflatten(0, (2, -1))
    assert bool((with_codes == winner.parameters.shape).all()) and not bool(mean.any())


@pytest.mark.parametrize("turn", [math.pi, math.pi / 2])
def test_a_rival_beats_a_camera_that_is_wrong(tiny: Model, photo: Photo, fitted: FitStep, turn: float):
    problem = problem_of(tiny, photo)
    schedule = build_schedule(QUICK, ALL_COMPONENTS, unknown=1)
    wrong = scored_winner(problem, fitted, turn)
    *_, rivals = optimise_rivals(problem, wrong, schedule, seeded())
    assert float(rivals.best.loss) < float(wrong.loss)
    right = scored_winner(problem, fitted)
    *_, rivals = optimise_rivals(problem, right, schedule, seeded())
    assert float(rivals.best.loss) > float(right.loss)
    assert bool(torch.isfinite(rivals.loss).all())


def test_margins_of_five_seeds_differ_little(tiny: Model, photo: Photo, fitted: FitStep):
    problem = problem_of(tiny, photo)
    winner = scored_winner(problem, fitted)
    schedule = build_schedule(QUICK, ALL_COMPONENTS, unknown=1)
    margins = []
    for seed in range(5):
        *_, rivals = optimise_rivals(problem, winner, schedule, seeded(seed))
        margins.append(math.log(float(rivals.best.loss) / float(winner.loss)))
    assert torch.tensor(margins).std() < 0.3 * min(margins)


def test_a_search_that_ends_behind_the_object_is_turned_round(
    tiny: Model, photo: Photo, fitted: FitStep, monkeypatch: pytest.MonkeyPatch
):
    """The rivals lead to the right camera where the search found the opposite one alone."""

    def behind(problem: Problem, *_: object) -> HypothesisBatch:
        return scored_winner(problem, fitted, math.pi)

    monkeypatch.setattr(search, "select", behind)
    *_, turned = fit(tiny, FitJob((photo,), replace(QUICK, free_steps=0)))
    assert rotation_error(turned.cameras[0], tiny.camera(AZIMUTH, ELEVATION)) < 10
    assert turned.runner_up is not None and turned.margin is not None
    assert rotation_error(turned.runner_up.cameras[0], turned.cameras[0]) > 20
    assert turned.margin > 0
