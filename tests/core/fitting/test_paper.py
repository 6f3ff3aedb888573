"""The paper's recipe."""

import math
from dataclasses import replace
from itertools import count

import pytest
import torch

from core.fitting import paper
from core.fitting.fit import PRESETS, FitJob, FitStep
from core.fitting.hypotheses import Hypothesis
from core.fitting.objective import ObjectiveValue
from core.fitting.paper import fit
from core.metrics import rotation_error
from core.models.model import Model
from core.photos.photo import Photo
from tests.conftest import unchecked_shapes
from tests.core.tiny import photo_of

PAPER = replace(PRESETS["paper"], steps=120, rays=96, samples=20)


def last(model: Model, *photos: Photo, settings=PAPER) -> FitStep:
    *_, step = fit(model, FitJob(photos, settings))
    return step


def test_the_paper_starts_from_one_random_or_resumed_camera(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(0.4, 0.2))
    starts = [next(fit(tiny, FitJob((photo,), PAPER, seed))) for seed in range(12)]
    assert {step.active for step in starts} == {1}
    assert all(step.cameras[0].elevation > -0.11 for step in starts)
    assert len({round(step.cameras[0].azimuth) for step in starts}) > 3
    # AdamW's first step is its rate, whatever the slope.
    moved = (starts[0].instance.codes.shape - tiny.codes.mean.shape).abs()
    torch.testing.assert_close(moved, torch.full_like(moved, 0.01), rtol=0.05, atol=1e-4)
    truth = tiny.camera(1.2, 0.3)
    begin = Hypothesis(0, 0.0, (truth,), tiny.mean, torch.zeros(1, 4))
    first = next(fit(tiny, FitJob((photo_of(tiny[0], truth),), PAPER, resume_from=begin)))
    assert rotation_error(first.cameras[0], truth) < 10  # AdamW's first step is its rate: 0.1 rad


@pytest.mark.usefixtures("unchecked")
def test_the_paper_recipe_moves_the_camera_towards_the_truth(tiny: Model):
    """From a start that is given: where a random one leads is a matter of chance."""
    truth = tiny.camera(1.2, 0.3)
    start = tiny.camera(1.45, 0.4)
    begin = Hypothesis(0, 0.0, (start,), tiny.mean, torch.zeros(1, 4))
    job = FitJob((photo_of(tiny[0], truth),), replace(PAPER, steps=60), resume_from=begin)
    steps = list(fit(tiny, job))
    assert len(steps) == 60
    assert rotation_error(steps[-1].cameras[0], truth) < 0.6 * rotation_error(start, truth)


def test_the_paper_recipe_keeps_known_cameras(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5)]
    first, second = (photo_of(tiny[1], truth) for truth in truths)
    step = last(tiny, replace(first, camera=truths[0]), second, settings=replace(PAPER, steps=12))
    assert step.confidence is None
    assert rotation_error(step.cameras[0], truths[0]) < 1e-3
    with unchecked_shapes():
        fitted = last(tiny, replace(first, camera=truths[0]), settings=PAPER)
    assert fitted.psnr > 25


def test_the_best_step_before_divergence_is_kept(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    calls = count()
    evaluate = paper.paper_objective

    def diverging(*arguments: object) -> ObjectiveValue:
        value = evaluate(*arguments)
        return value._replace(objective=value.objective * math.nan) if next(calls) > 13 else value

    monkeypatch.setattr(paper, "paper_objective", diverging)
    photo = photo_of(tiny[0], tiny.camera(1.2, 0.3))
    steps = list(fit(tiny, FitJob((photo,), replace(PAPER, steps=20))))
    assert len(steps) == 20
    (loss,) = {step.loss for step in steps[13:]}
    assert math.isfinite(loss)
