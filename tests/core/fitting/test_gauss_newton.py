"""Gauss-Newton steps go down, and leave alone what is given."""

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
    return gauss_newton_step(model, batch, pixels, torch.zeros_like(pixels.target_opacity), STAGE, OBJECTIVE, free)


@pytest.mark.parametrize("zoom", [-0.3, 0.0, 0.3])
def test_rays_turn_with_every_number_of_a_camera_as_by_small_steps(tiny: Model, zoom: float):
    pixels, parameters = pixels_of(tiny), random_parameters(1)
    at = parameters._replace(zoom=torch.full((1, 1), zoom), crop_transform=torch.tensor([[[0.1, 0.3, 0.05, -0.08]]]))
    parts, small = ((0, 0), (0, 1), (1, None), (2, None), (3, 0), (3, 1), (3, 2), (3, 3)), 1e-3
    jacobian = camera_jacobian(at, hypothesis_rays(tiny, at, pixels))
    for slope, (part, axis) in zip(jacobian.unbind(-1), parts, strict=True):
        there = []
        for step in (-small, small):
            moved = at[part].clone()
            moved[..., slice(None) if axis is None else axis] += step
            rays = hypothesis_rays(tiny, Parameters(*at[:part], moved, *at[part + 1 :]), pixels)
            there.append((rays.origins.expand_as(rays.directions), rays.directions))
        for index in range(2):
            expected = (there[1][index] - there[0][index]) / (2 * small)
            torch.testing.assert_close(slope.chunk(2, -1)[index], expected, atol=2e-3, rtol=2e-3)


def test_a_camera_may_be_the_further_off_the_more_else_can_make_up_for_it(tiny: Model):
    one, pixels = HypothesisBatch.of(Parameters(*(part[:1] for part in random_parameters()))), pixels_of(tiny)
    turned = torch.tensor([[True, True, False, False, False, False, False, False]])

    def off(free: torch.Tensor) -> float:
        return camera_uncertainty(tiny, one, pixels, STAGE, OBJECTIVE, free, 0)

    assert 0 < off(turned) < off(FREE) < math.pi
    assert off(torch.zeros_like(turned)) == 0


def test_two_views_share_codes_and_not_cameras(tiny: Model):
    photos = [photo_of(tiny[0], tiny.camera(azimuth, 0.5)) for azimuth in (0.5, 2.5)]
    pixels = sample_pixels([Observation.of(photo, tiny) for photo in photos], 32, seeded())
    one = random_parameters(2)
    both = Parameters(*(part.repeat(1, 2, *[1] * (part.ndim - 2)) for part in one[:4]), *one[4:])
    found = normal_equations(tiny, both, pixels, None, STAGE, OBJECTIVE)
    assert found.hessian.shape == (2, 20, 20)
    assert not bool(found.hessian[:, :8, 8:16].any())
    assert bool(found.hessian[:, 8:12, 16:].any())


def test_a_given_camera_stays_wherever_it_is(tiny: Model):
    one = random_parameters(1)
    beyond = one._replace(angles=torch.full((1, 1, 2), math.pi / 2), distance=torch.full((1, 1), -2.0))
    pixels, still = pixels_of(tiny), torch.zeros(1, 8, dtype=torch.bool)
    batch = step_of(tiny, HypothesisBatch.of(beyond), pixels, still)
    assert torch.equal(batch.parameters.angles, beyond.angles)
    assert torch.equal(batch.parameters.distance, beyond.distance)
    free = step_of(tiny, HypothesisBatch.of(beyond), pixels, FREE).parameters
    assert float(free.angles[..., 1]) < math.pi / 2
    assert float(free.distance) >= -1


def test_steps_go_down_and_leave_alone_what_is_given(tiny: Model):
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


def test_one_that_diverged_stays_out_and_the_others_go_on(tiny: Model):
    pixels = pixels_of(tiny)

    def stepped(parameters: Parameters) -> HypothesisBatch:
        batch = HypothesisBatch.of(parameters)
        for _ in range(STAGE.steps):
            batch = step_of(tiny, batch, pixels, FREE)
        return batch

    parameters = random_parameters()
    parameters.shape[1] = torch.nan
    batch, without = stepped(parameters), stepped(random_parameters())
    assert batch.loss.isfinite().tolist() == [True, False, True]
    torch.testing.assert_close(batch.loss[[0, 2]], without.loss[[0, 2]], rtol=0.05, atol=1e-4)


@pytest.mark.parametrize("blur", [0.0, 1.5])
@pytest.mark.parametrize(("hypotheses", "rays"), [(1, 700), (40, 60)])
def test_equations_are_the_same_bits_with_any_number_of_threads(
    tiny: Model, blur: float, hypotheses: int, rays: int, monkeypatch: pytest.MonkeyPatch
):
    photos = [replace(photo_of(tiny[0], tiny.camera(azimuth, 0.5)), blur=blur) for azimuth in (0.5, 2.5)]
    pixels = sample_pixels([Observation.of(photo, tiny) for photo in photos], rays, seeded())
    one = random_parameters(hypotheses)
    both = Parameters(*(part.repeat(1, 2, *[1] * (part.ndim - 2)) for part in one[:4]), *one[4:])
    equations = []
    for threads in ("1", "2", "8"):
        monkeypatch.setenv("CODENERF_THREADS", threads)
        equations.append(normal_equations(tiny, both, pixels, None, STAGE, OBJECTIVE))
    for same in equations[1:]:
        assert all(torch.equal(*pair) for pair in zip(same, equations[0], strict=True))
