"""Photos from several sides free the network of an object, which explains more and adds no haze."""

import math
from dataclasses import replace

import pytest
import torch

from core.fitting import network
from core.fitting.fit import FitJob, fit
from core.fitting.hypotheses import HypothesisBatch, Parameters
from core.fitting.network import frees_network
from core.fitting.problem import Problem
from core.metrics import haze, psnr
from core.models.model import Instance, Model
from core.models.network import has_network
from core.photos.photo import Photo
from core.rendering.images import render_image
from tests.core.fitting.inputs import SHORT, seeded
from tests.core.models.test_network import owning
from tests.core.tiny import photo_of

SETTINGS = replace(SHORT, steps=20, rays=192, samples=24, free_steps=12)
AZIMUTHS = 0.3, 2.4, 4.5
SCALE = 0.06


def photos(model: Model, azimuths=AZIMUTHS, scale: float = SCALE) -> tuple[Photo, ...]:
    cameras = [model.camera(azimuth, 0.4) for azimuth in azimuths]
    return tuple(replace(photo_of(owning(model, 0, scale), camera), camera=camera) for camera in cameras)


@pytest.mark.parametrize(
    ("azimuths", "left_out", "expected"),
    [
        ((0.0, 45.0, 91.0), None, True),
        ((0.0, 45.0, 89.0), None, False),
        ((0.0, 180.0), None, False),
        ((0.0, 0.0, 180.0), None, True),
        ((-170.0, 170.0, 179.0), None, False),
        ((-130.0, 170.0, 130.0), None, True),
        ((359.0, 1.0, 720.0, 271.0), None, False),
        ((0.0, 120.0, 240.0), 2, False),
        ((0.0, 10.0, 240.0, 20.0), 2, False),
        ((0.0, 10.0, 240.0, 95.0), 2, True),
    ],
)
def test_three_photos_over_ninety_degrees_free_the_network(tiny: Model, azimuths, left_out, expected):
    problem = Problem.of(tiny, FitJob(photos(tiny, (0.0,) * len(azimuths)), SHORT), seeded())
    problem = problem if left_out is None else problem.without(left_out)
    views = len(azimuths)
    angles = torch.stack((torch.tensor(azimuths).deg2rad(), torch.zeros(views)), -1)[None]
    zeros = torch.zeros(1, views)
    parameters = Parameters(angles, zeros, zeros, torch.zeros(1, views, 4), torch.zeros(1, 2), torch.zeros(1, 2))
    assert frees_network(problem, HypothesisBatch.of(parameters)) is expected


def test_a_network_explains_an_object_that_no_bias_reaches(tiny: Model):
    fingerprint = tiny.fingerprint
    job = FitJob(photos(tiny), SETTINGS)
    steps = list(fit(tiny, job))
    *_, biases = fit(tiny, replace(job, components=replace(job.components, network=False)))
    assert has_network(tiny, steps[-1].instance.codes) and not has_network(tiny, biases.instance.codes)
    assert [step.is_free for step in steps[-25:]] == [False] + [True] * 24
    assert {step.steps - step.step for step in steps[-24:]} == set(range(24))
    unseen = tiny.camera(1.3, 0.5)
    truth = render_image(owning(tiny, 0, SCALE), unseen).colour
    before, after = (
        psnr(render_image(step.instance.with_detail(None), unseen).colour, truth) for step in (biases, steps[-1])
    )
    assert after > before + 1.0
    losses = [step.loss for step in steps[-12:]]
    assert losses == sorted(losses, reverse=True)
    assert steps[-1].instance.detail.fitted.shape_key == steps[-1].instance.codes.shape_key
    del vars(tiny)["fingerprint"]
    assert tiny.fingerprint == fingerprint
    assert not any(weight.requires_grad or weight.grad is not None for weight in tiny.field.parameters())


@pytest.mark.parametrize("azimuths", [(0.3, 2.4, 4.5), (0.3, 0.5, 1.0)], ids=["around", "one side"])
def test_photos_that_contradict_each_other_are_not_explained_by_haze(tiny: Model, azimuths):
    cameras = [tiny.camera(azimuth, 0.4) for azimuth in azimuths]
    contradicting = tuple(replace(photo_of(tiny[index], camera), camera=camera) for index, camera in enumerate(cameras))
    job = FitJob(contradicting, SETTINGS)
    *_, network = fit(tiny, job)
    *_, biases = fit(tiny, replace(job, components=replace(job.components, network=False)))
    assert has_network(tiny, network.instance.codes) <= (azimuths[-1] > 2)
    before, after = (mean_haze(step.instance.with_detail(None)) for step in (biases, network))
    assert after <= before + 0.02


def mean_haze(instance: Instance) -> float:
    cameras = [instance.model.camera(azimuth, 0.4) for azimuth in (1.3, 3.4, 5.5)]
    return sum(haze(render_image(instance, camera).opacity.numpy()) for camera in cameras) / len(cameras)


def test_a_training_that_diverges_leaves_the_best_network_so_far(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(network, "_RATE", math.inf)
    steps = list(fit(tiny, FitJob(photos(tiny), SETTINGS)))
    assert steps[-1].step == steps[-1].steps and not has_network(tiny, steps[-1].instance.codes)
