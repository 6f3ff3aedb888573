"""A search between its initial hypotheses and its result."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from core.fitting import fit as fits
from core.fitting import search
from core.fitting.fit import FitJob, FitSettings, fit
from core.fitting.hypotheses import DivergedError, HypothesisBatch, Parameters, to_cameras
from core.fitting.initial import initial_hypotheses
from core.fitting.objective import CAMERA_PRIOR_SCALE, MOVED_SCALE, SCALED_SCALE
from core.fitting.schedule import build_schedule
from core.fitting.search import SearchResult, better_of, optimise, refine, score, select
from core.fitting.settings import ALL_COMPONENTS, Components
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import SHORT, problem_of, seeded
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit runs fits with checks


def stool(model: Model, posed: bool = False) -> Photo:
    camera = model.camera(0.9, 0.3)
    photo = photo_of(model[0], camera)
    return replace(photo, camera=camera) if posed else photo


def test_a_crop_has_its_scale_searched_instead_of_the_distance(tiny: Model):
    photo = stool(tiny)
    moved = replace(photo, cropped=True)
    scaled = replace(photo, cropped=True, scaled=True)
    problem = problem_of(tiny, photo, moved, scaled, replace(scaled, camera=tiny.camera(0.9, 0.3)))
    distance = problem.free[:, 2].tolist()
    scale = problem.free[:, 4].tolist()
    assert (distance, scale) == ([True, False, False, False], [False, True, True, False])
    prior = problem.objective(math.inf).camera_scale
    torch.testing.assert_close(prior[:, 3], torch.tensor([CAMERA_PRIOR_SCALE[3], MOVED_SCALE, SCALED_SCALE, math.inf]))
    assert prior[:, 5].isinf().tolist() == [False, True, True, True]
    expected = problem.objective(math.inf).expected_scale
    assert expected.any(1).tolist() == [False, False, True, False]


def test_a_known_focal_length_has_the_distance_searched(tiny: Model):
    photo = replace(stool(tiny), cropped=True, scaled=True, focal=2 * tiny.focal)
    problem = problem_of(tiny, photo)
    assert problem.free[0, 2:5].tolist() == [True, False, False]
    batch = initial_hypotheses(problem, 4, seeded())
    cameras = to_cameras(tiny, batch.parameters, 0, problem.cameras)
    assert cameras[0].focal == pytest.approx(2 * tiny.focal)
    assert cameras[0].distance == pytest.approx(2 * tiny.distance, rel=0.3)


def test_disabled_components_are_left_out_of_the_objective(tiny: Model):
    off = Components(camera_prior=False, mask_loss=False, viewpoint_classifier=False)
    problem = problem_of(tiny, stool(tiny), components=off)
    objective = problem.objective(0.2)
    assert not objective.camera_weight.any()
    assert objective.mask_weight == 0
    assert problem.viewpoints == (None,)


# Pruning


@pytest.mark.parametrize("posed", [True, False])
def test_the_best_hypotheses_are_kept(tiny: Model, posed: bool):
    problem = problem_of(tiny, stool(tiny, posed), settings=SHORT)
    batch = initial_hypotheses(problem, 6, seeded())
    ranked = replace(batch, loss=torch.arange(len(batch), dtype=torch.float32).flip(0))
    stages = build_schedule(SHORT, ALL_COMPONENTS, unknown=not posed).local
    first = next(optimise(problem, ranked, (stages[0]._replace(hypotheses=2),), seeded()))
    assert first.origin.tolist() == [len(batch) - 1, len(batch) - 2]
    lost = replace(batch, loss=torch.full_like(batch.loss, math.inf))
    with pytest.raises(DivergedError):
        next(optimise(problem, lost, (stages[0]._replace(hypotheses=2),), seeded()))


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
    monkeypatch.setattr(fits, "refine", diverging)
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


# Refinement and complete searches


@pytest.mark.parametrize("steps", [1, 8, 30])
def test_refinement_yields_the_best_score_so_far(tiny: Model, steps: int):
    settings = replace(SHORT, steps=steps)
    final = build_schedule(settings, ALL_COMPONENTS, unknown=False).final
    steps_of_fit = list(fit(tiny, FitJob((stool(tiny, posed=True),), settings)))
    ending = [step.loss for step in steps_of_fit if step.step > steps_of_fit[0].steps - final.steps]
    assert ending == sorted(ending, reverse=True)
    assert steps_of_fit[-1].step == steps_of_fit[-1].steps


def test_random_starts_end_no_worse_than_they_began(tiny: Model):
    for seed in range(4):
        assert_search_ends_well(tiny, seed)


@pytest.mark.slow
def test_a_thousand_random_starts_end_no_worse_than_they_began(tiny: Model):
    for seed in range(1000):
        assert_search_ends_well(tiny, seed)


def assert_search_ends_well(model: Model, seed: int) -> None:
    """A photo of anything from starts anywhere: each step finite, the end no worse than the start it came from."""
    generator = seeded(seed)

    def random(*size: int) -> torch.Tensor:
        return torch.rand(size, generator=generator)

    height, width = (int(side) for side in 8 + 40 * random(2))
    mask = random(height, width) > random(1)
    mask[height // 2, width // 2] = True
    pixels = torch.where(mask[..., None], random(height, width, 3), torch.ones(3))
    photo = Photo(pixels, mask, cropped=seed % 2 == 0)
    settings = FitSettings(hypotheses=4, steps=9, rays=48, samples=12)
    problem = problem_of(model, photo, settings=settings, seed=seed)
    generator_of_search = seeded(seed)
    coarse, local, final, *_ = build_schedule(settings, ALL_COMPONENTS, unknown=True)
    batch = first = HypothesisBatch.of(
        Parameters(
            (random(4, 1, 2) - 0.5) * torch.tensor([2 * math.pi, math.pi]),
            3 * random(4, 1) - 1.5,
            random(4, 1) - 0.5,
            0.4 * random(4, 1, 4) - 0.2,
            8 * random(4, 2) - 4,
            8 * random(4, 2) - 4,
        )
    )
    for batch in optimise(problem, first, (*coarse, *local), generator_of_search):
        assert_finite(batch)
    selected = select(problem, batch, first, final)
    for end in refine(problem, selected, final, generator_of_search):
        assert_finite(end.best)
    began = score(problem, first[end.best.origin], final.robust_scale)
    assert float(end.best.loss) <= float(began.loss) + 1e-6


def assert_finite(batch: HypothesisBatch) -> None:
    best = batch.best
    assert math.isfinite(float(best.loss)) and math.isfinite(float(best.squared_error))
    assert all(bool(values.isfinite().all()) for values in batch.parameters)
