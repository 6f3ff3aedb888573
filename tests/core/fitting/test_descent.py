"""Hypotheses between their start and their result."""

import math
from dataclasses import replace

import pytest
import torch

from core.fitting.descent import optimise, refine, score, select
from core.fitting.fit import FitJob, FitSettings, fit
from core.fitting.hypotheses import DivergedError, HypothesisBatch, Parameters
from core.fitting.initial import initial_hypotheses
from core.fitting.schedule import build_schedule
from core.fitting.settings import ALL_COMPONENTS
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import SHORT, problem_of, seeded
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit runs fits with checks


def stool(model: Model, posed: bool = False) -> Photo:
    camera = model.camera(0.9, 0.3)
    photo = photo_of(model[0], camera)
    return replace(photo, camera=camera) if posed else photo


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
