"""Gauss-Newton steps reduce the loss and keep fixed parameters."""

import math
from dataclasses import replace

import pytest
import torch

from core.fitting.gauss_newton import camera_jacobian, camera_uncertainty, gauss_newton_step, normal_equations
from core.fitting.hypotheses import HypothesisBatch, Parameters, hypothesis_rays
from core.fitting.objective import Objective
from core.fitting.observations import Observation, PixelBatch, sample_pixels
from core.fitting.schedule import Stage
from core.models.model import Model
from tests.core.fitting.inputs import pixels_of, random_parameters, seeded
from tests.core.tiny import photo_of

STAGE = Stage(3, 4, 96, 24, math.inf, 0.3)
OBJECTIVE = Objective(1e-4)
FREE = torch.tensor([[True, True, True, True, False, False, False, False]])


def step_of(model: Model, batch: HypothesisBatch, pixels: PixelBatch, free: torch.Tensor) -> HypothesisBatch:
    jitter = torch.zeros_like(pixels.target_opacity)
    equations = normal_equations(model, batch.parameters, pixels, jitter, STAGE, OBJECTIVE)
    return gauss_newton_step(batch, equations, STAGE, free)


def two_views(count: int) -> Parameters:
    """The same camera for two views of each hypothesis."""
    *camera, shape, texture = random_parameters(count)
    return Parameters(*(values.repeat(1, 2, *[1] * (values.ndim - 2)) for values in camera), shape, texture)


@pytest.mark.parametrize("zoom", [-0.3, 0.0, 0.3])
def test_the_camera_jacobian_equals_finite_differences(tiny: Model, zoom: float):
    pixels = pixels_of(tiny)
    crop_transform = torch.tensor([[[0.1, 0.3, 0.05, -0.08]]])
    base = random_parameters(1)._replace(zoom=torch.full((1, 1), zoom), crop_transform=crop_transform)
    places = ((0, 0), (0, 1), (1, None), (2, None), (3, 0), (3, 1), (3, 2), (3, 3))
    delta = 1e-3
    jacobian = camera_jacobian(base, hypothesis_rays(tiny, base, pixels))
    for slope, (field, axis) in zip(jacobian.unbind(-1), places, strict=True):
        ends = []
        for step in (-delta, delta):
            moved = base[field].clone()
            moved[..., slice(None) if axis is None else axis] += step
            rays = hypothesis_rays(tiny, Parameters(*base[:field], moved, *base[field + 1 :]), pixels)
            ends.append((rays.origins.expand_as(rays.directions), rays.directions))
        for index in range(2):
            expected = (ends[1][index] - ends[0][index]) / (2 * delta)
            torch.testing.assert_close(slope.chunk(2, -1)[index], expected, atol=2e-3, rtol=2e-3)


def test_a_camera_is_less_certain_if_more_parameters_are_free(tiny: Model):
    hypothesis = HypothesisBatch.of(Parameters(*(values[:1] for values in random_parameters())))
    pixels = pixels_of(tiny)
    turned = torch.tensor([[True, True, False, False, False, False, False, False]])

    def uncertainty(free: torch.Tensor) -> float:
        return camera_uncertainty(tiny, hypothesis, pixels, STAGE, OBJECTIVE, free, torch.tensor([True]))

    assert 0 < uncertainty(turned) < uncertainty(FREE) < math.pi
    assert uncertainty(torch.zeros_like(turned)) == 0


def test_two_views_share_codes_and_not_cameras(tiny: Model):
    photos = [photo_of(tiny[0], tiny.camera(azimuth, 0.5)) for azimuth in (0.5, 2.5)]
    pixels = sample_pixels([Observation.of(photo, tiny) for photo in photos], 32, seeded())
    equations = normal_equations(tiny, two_views(2), pixels, None, STAGE, OBJECTIVE)
    assert equations.hessian.shape == (2, 20, 20)
    assert not bool(equations.hessian[:, :8, 8:16].any())
    assert bool(equations.hessian[:, 8:12, 16:].any())


def test_a_fixed_camera_is_neither_moved_nor_clamped(tiny: Model):
    parameters = random_parameters(1)
    beyond = parameters._replace(angles=torch.full((1, 1, 2), math.pi / 2), distance=torch.full((1, 1), -2.0))
    pixels = pixels_of(tiny)
    fixed = torch.zeros(1, 8, dtype=torch.bool)
    batch = step_of(tiny, HypothesisBatch.of(beyond), pixels, fixed)
    assert torch.equal(batch.parameters.angles, beyond.angles)
    assert torch.equal(batch.parameters.distance, beyond.distance)
    free = step_of(tiny, HypothesisBatch.of(beyond), pixels, FREE).parameters
    assert float(free.angles[..., 1]) < math.pi / 2
    assert float(free.distance) >= -1


def test_steps_reduce_the_loss_and_keep_fixed_parameters(tiny: Model):
    batch = first = HypothesisBatch.of(random_parameters())
    pixels = pixels_of(tiny)
    free = torch.tensor([[True, False, True, False, False, False, False, False]])
    losses = []
    for _ in range(STAGE.steps + 1):
        batch = step_of(tiny, batch, pixels, free)
        losses.append(batch.loss)
    assert bool((losses[-1] < losses[0]).all())
    assert bool((losses[-1] < 0.7 * losses[0]).any())
    assert torch.equal(batch.parameters.angles[..., 1], first.parameters.angles[..., 1])
    assert not torch.equal(batch.parameters.angles[..., 0], first.parameters.angles[..., 0])
    assert torch.equal(batch.parameters.zoom, first.parameters.zoom)
    assert torch.equal(batch.parameters.crop_transform, first.parameters.crop_transform)


def test_a_diverged_hypothesis_does_not_affect_the_others(tiny: Model):
    pixels = pixels_of(tiny)

    def stepped(parameters: Parameters) -> HypothesisBatch:
        batch = HypothesisBatch.of(parameters)
        for _ in range(STAGE.steps):
            batch = step_of(tiny, batch, pixels, FREE)
        return batch

    parameters = random_parameters()
    parameters.shape[1] = torch.nan
    batch = stepped(parameters)
    without = stepped(random_parameters())
    assert batch.loss.isfinite().tolist() == [True, False, True]
    torch.testing.assert_close(batch.loss[[0, 2]], without.loss[[0, 2]], rtol=0.05, atol=1e-4)


@pytest.mark.parametrize("blur", [0.0, 1.5])
@pytest.mark.parametrize(("hypotheses", "rays"), [(1, 700), (40, 60)])
def test_equations_are_the_same_bits_with_any_number_of_threads(
    tiny: Model, blur: float, hypotheses: int, rays: int, monkeypatch: pytest.MonkeyPatch
):
    photos = [replace(photo_of(tiny[0], tiny.camera(azimuth, 0.5)), blur=blur) for azimuth in (0.5, 2.5)]
    pixels = sample_pixels([Observation.of(photo, tiny) for photo in photos], rays, seeded())
    parameters = two_views(hypotheses)
    equations = []
    for threads in ("1", "2", "8"):
        monkeypatch.setenv("CODENERF_THREADS", threads)
        equations.append(normal_equations(tiny, parameters, pixels, None, STAGE, OBJECTIVE))
    for repeated in equations[1:]:
        assert all(torch.equal(*pair) for pair in zip(repeated, equations[0], strict=True))
