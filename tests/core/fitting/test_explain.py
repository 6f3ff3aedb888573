from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from core.fitting.explain import explain
from core.fitting.fit import FitJob, FitStep, fit
from core.fitting.settings import FitSettings
from core.models.model import Model
from tests.core.tiny import photo_of, tiny_bank


@pytest.fixture(scope="module")
def job(tiny: Model) -> FitJob:
    return FitJob(
        (photo_of(tiny, tiny.codes[2], tiny.camera(0.7, 0.4)),), tiny_bank(), FitSettings(hypotheses=6, steps=12)
    )


@pytest.fixture(scope="module")
def steps(tiny: Model, job: FitJob) -> list[FitStep]:
    return list(fit(tiny, job))


def test_stages_end_with_what_they_kept_and_candidates_and_terms_tell_why(
    tiny: Model, job: FitJob, steps: list[FitStep]
):
    found = explain(tiny, job, steps)
    assert found.stages[-1] is steps[-1]
    assert [step for step, after in pairwise(steps) if step.stage != after.stage] == list(found.stages[:-1])
    assert found.candidates is not None
    assert torch.isfinite(found.candidates.score).all()
    assert float(found.candidates.score[0]) == float(found.candidates.score.max())
    result, other = found.terms
    assert list(result) == ["photometric", "mask", "camera prior", "code prior"]
    assert 0 < sum(result.values()) < sum(other.values())


def test_of_a_known_camera_there_are_no_candidates(tiny: Model, job: FitJob):
    known = replace(job, photos=(replace(job.photos[0], camera=tiny.camera(0.7, 0.4)),))
    assert explain(tiny, known, fit(tiny, known)).candidates is None


def test_a_fit_without_steps_explains_nothing(tiny: Model, job: FitJob):
    with pytest.raises(ValueError, match="no step"):
        explain(tiny, job, ())
