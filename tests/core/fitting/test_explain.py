from itertools import pairwise

import pytest
import torch

from core.fitting.explain import explain
from core.fitting.fit import FitJob, fit
from core.fitting.settings import FitSettings
from core.models.model import Model
from core.photos.photo import Photo
from core.rendering.reference import render_exact


@pytest.fixture(scope="module")
def job(tiny: Model) -> FitJob:
    seen = render_exact(tiny, tiny.codes[2], tiny.camera(0.7, 0.4))
    return FitJob((Photo(seen.colour.clamp(0, 1), seen.opacity > 0.5),), FitSettings(hypotheses=6, steps=12))


def test_every_stage_ends_with_the_hypotheses_that_it_kept(tiny: Model, job: FitJob):
    steps = list(fit(tiny, job))
    stages = explain(tiny, job, steps).stages
    assert stages[-1] is steps[-1]
    assert [step for step, after in pairwise(steps) if step.active != after.active] == list(stages[:-1])


def test_the_best_candidate_comes_first(tiny: Model, job: FitJob):
    candidates = explain(tiny, job, fit(tiny, job)).candidates
    assert candidates is not None
    assert torch.isfinite(candidates.score).all()
    assert float(candidates.score[0]) == float(candidates.score.max())


def test_terms_are_named_and_the_result_costs_less_than_the_other_basin(tiny: Model, job: FitJob):
    result, other = explain(tiny, job, fit(tiny, job)).terms
    assert list(result) == ["photometric", "mask", "camera prior", "code prior"]
    assert 0 < sum(result.values()) < sum(other.values())


def test_of_a_known_camera_there_are_no_candidates(tiny: Model, job: FitJob):
    (photo,) = job.photos
    known = FitJob((Photo(photo.pixels, photo.mask, tiny.camera(0.7, 0.4)),), job.settings)
    assert explain(tiny, known, fit(tiny, known)).candidates is None


def test_a_fit_without_steps_explains_nothing(tiny: Model, job: FitJob):
    with pytest.raises(ValueError, match="no step"):
        explain(tiny, job, ())
