"""Each loss term as a value, as weighted residuals and by autograd: all three must agree."""

import math
from collections.abc import Callable

import pytest
import torch

from core.fitting.gauss_newton import normal_equations
from core.fitting.hypotheses import Parameters
from core.fitting.objective import (
    CAMERA_PRIOR_SCALE,
    MOVED_SCALE,
    OCCLUDER_SCALE,
    Objective,
    Term,
    camera_prior_term,
    code_prior_term,
    evaluate_objective,
    image_squared_error,
    mask_term,
    photometric_term,
    viewpoint_weights,
)
from core.fitting.observations import Observation, PixelBatch, sample_pixels
from core.fitting.schedule import Stage
from core.models.model import Model
from core.models.precision import use_dtype
from core.models.viewpoint import directions
from core.rendering.folded_field import AxisLookup
from tests.core.tiny import photo_of

KNOWN = (math.inf,) * 7
MOVED = (*CAMERA_PRIOR_SCALE[:3], MOVED_SCALE, CAMERA_PRIOR_SCALE[4], math.inf, math.inf)
ROBUST = [math.inf, 0.2, 0.02]


def parameters_of(count: int = 3, elevation: float = 0.5) -> Parameters:
    generator = torch.Generator().manual_seed(0)
    angles = torch.tensor([0.5, elevation]) + 0.2 * torch.rand(count, 1, 2, generator=generator)
    distance, zoom = 0.1 * torch.randn(count, 1, generator=generator), torch.full((count, 1), 0.1)
    shape, texture = (torch.randn(count, 2, generator=generator) for _ in range(2))
    return Parameters(angles, distance, zoom, torch.zeros(count, 1, 4), shape, texture)


def pixels_of(model: Model, rays: int = 96) -> PixelBatch:
    photo = photo_of(model, model.codes[0], model.camera(0.5, 0.5))
    return sample_pixels([Observation.of(photo, model)], rays, torch.Generator().manual_seed(0))


def agrees(term: Callable[[torch.Tensor], Term], at: torch.Tensor) -> None:
    """The gradient of a term's value is twice its weighted residual: residuals move as fast as ``at`` does."""
    at = at.clone().requires_grad_()
    found = term(at)
    (gradient,) = torch.autograd.grad(found.value.sum(), at)
    expected = (2 * found.weight * found.residual).detach()
    torch.testing.assert_close(gradient, expected.reshape(gradient.shape), rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("occluder_scale", [math.inf, OCCLUDER_SCALE])
@pytest.mark.parametrize("robust_scale", ROBUST)
def test_residuals_of_images_have_the_gradient_of_their_value(tiny: Model, robust_scale: float, occluder_scale: float):
    pixels = pixels_of(tiny)
    rendered = torch.rand(3, 1, 96, 3, generator=torch.Generator().manual_seed(1))
    objective = Objective(1e-4, robust_scale=robust_scale, occluder_scale=occluder_scale)
    agrees(lambda colour: photometric_term(colour, pixels, objective), rendered)
    agrees(lambda opacity: mask_term(opacity, pixels, objective), rendered[..., 0])


def test_residuals_of_codes_have_the_gradient_of_their_value():
    agrees(lambda code: code_prior_term(code, 1e-3), parameters_of().shape)


@pytest.mark.parametrize("expected", [None, torch.linspace(-0.5, 0.5, len(directions()[0]))[None]])
@pytest.mark.parametrize("elevation", [0.5, -0.9])
def test_residuals_of_cameras_have_the_gradient_of_their_value(elevation: float, expected: torch.Tensor | None):
    at, objective = parameters_of(elevation=elevation), Objective(1e-4, expected_scale=expected)

    def term(numbers: torch.Tensor) -> Term:
        angles, distance, zoom, picture = numbers.split((2, 1, 1, 4), -1)
        moved = at._replace(angles=angles, distance=distance[..., 0], zoom=zoom[..., 0], picture=picture)
        return camera_prior_term(moved, objective)

    picture = torch.tensor([0.1, -0.02, 0.03, 0.01]).expand(3, 1, 4)
    agrees(term, torch.cat((at.angles, at.distance[..., None], at.zoom[..., None], picture), -1))


@pytest.mark.parametrize("elevation", [0.5, -0.3])
@pytest.mark.parametrize("occluder_scale", [math.inf, OCCLUDER_SCALE])
@pytest.mark.parametrize("robust_scale", ROBUST)
def test_gauss_newton_sees_the_objective_and_its_gradient(
    tiny: Model, monkeypatch: pytest.MonkeyPatch, robust_scale: float, occluder_scale: float, elevation: float
):
    """With two samples a ray, all of them are differentiated by both; tables would be off in the fourth digit."""
    monkeypatch.setattr(AxisLookup, "__call__", AxisLookup.evaluate)
    objective = Objective(1e-4, robust_scale=robust_scale, occluder_scale=occluder_scale)
    stage = Stage(3, 1, 96, 2, robust_scale, 0.3)
    at = Parameters(*(part.requires_grad_() for part in parameters_of(elevation=elevation)))
    pixels = pixels_of(tiny)
    with use_dtype(torch.float32):
        found = normal_equations(tiny, Parameters(*(part.detach() for part in at)), pixels, None, stage, objective)
        expected = evaluate_objective(tiny, at, pixels, stage.samples, objective)
    torch.testing.assert_close(found.objective, expected.objective, rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(found.squared_error, expected.squared_error, rtol=1e-4, atol=1e-7)
    parts = torch.autograd.grad(expected.objective.sum(), at)
    gradient = torch.cat([part.flatten(1) for part in parts], 1)
    torch.testing.assert_close(2 * found.gradient, gradient, rtol=1e-4, atol=1e-4 * float(gradient.abs().max()))
    assert bool((torch.linalg.eigvalsh(found.hessian.double()) > -1e-9).all())


def test_autograd_sees_the_objective_as_small_steps_do(tiny: Model):
    at, pixels, objective = parameters_of(1), pixels_of(tiny), Objective(1e-4, robust_scale=0.2)
    at.shape.requires_grad_()
    with use_dtype(torch.float32):
        value = evaluate_objective(tiny, at, pixels, 2, objective).objective.sum()
        (gradient,) = torch.autograd.grad(value, at.shape)
        for index in range(2):
            step = 1e-3 * torch.eye(2)[index]  # so short that no sample passes a kink on the way
            ends = [at._replace(shape=(at.shape + sign * step).detach()) for sign in (-1, 1)]
            low, high = (float(evaluate_objective(tiny, end, pixels, 2, objective).objective) for end in ends)
            assert float(gradient[0, index]) == pytest.approx((high - low) / 2e-3, rel=0.02)


def test_something_in_front_may_hide_an_object_but_not_show_one(tiny: Model):
    """Where the object is expected beside its mask a saturated price is paid; where it lacks, all of it."""
    pixels = pixels_of(tiny)
    strict, lenient = Objective(1e-4), Objective(1e-4, occluder_scale=OCCLUDER_SCALE)
    beside = (pixels.target_opacity < 0.5).float().expand(1, 1, -1)

    def price(opacity: torch.Tensor, objective: Objective) -> float:
        return float(mask_term(opacity, pixels, objective).value)

    extra, lacking = torch.maximum(pixels.target_opacity, 0.9 * beside), 0.1 * pixels.target_opacity[None]
    assert price(extra, lenient) < 0.3 * price(extra, strict)
    assert price(lacking, lenient) == pytest.approx(price(lacking, strict))
    white = torch.zeros(1, 1, len(pixels.pixels[0]), 3)
    seen = image_squared_error(white, extra, pixels, OCCLUDER_SCALE)
    assert float(seen) < float(image_squared_error(white, extra, pixels))


# What a camera costs


def standing(distance: float, elevation: float = 0.5, views: int = 1, zoom: float = 0.0) -> Parameters:
    angles = torch.tensor([0.0, elevation]).expand(1, views, 2)
    away, focal = (torch.full((1, views), value) for value in (distance, zoom))
    return Parameters(angles, away, focal, torch.zeros(1, views, 4), torch.zeros(1, 2), torch.zeros(1, 2))


def shown(scale: float, right: float = 0.0, views: int = 1) -> Parameters:
    picture = torch.tensor([scale, 0.0, right, 0.0]).expand(1, views, 4)
    return standing(0.0, views=views)._replace(picture=picture)


def cost(at: Parameters, *scales: tuple[float, ...]) -> float:
    return float(camera_prior_term(at, Objective(1e-4, torch.tensor(scales or [CAMERA_PRIOR_SCALE]))).value)


def test_the_usual_distance_costs_nothing_and_a_camera_below_the_ground_something():
    assert cost(standing(0.0)) == 0
    assert cost(standing(0.0, elevation=-0.2)) > 0
    assert cost(standing(0.0, zoom=0.4)) > 0


def test_a_photo_that_was_moved_says_less_about_its_scale_and_nothing_about_its_middle():
    assert 0 < cost(shown(0.05), MOVED) < cost(shown(0.05)) / 2
    assert cost(shown(0.0, right=0.2), MOVED) == 0 < cost(shown(0.0, right=0.02))


def test_a_scale_is_judged_by_what_objects_have_from_there():
    expected = torch.zeros(1, len(directions()[0])).add_(0.4)
    objective = Objective(1e-4, expected_scale=expected)
    usual, as_expected = (camera_prior_term(shown(scale), objective) for scale in (0.0, 0.4))
    assert float(as_expected.value) == pytest.approx(0, abs=1e-6)
    assert float(usual.value) > 1e-3


def test_every_photo_has_a_scale_of_its_own():
    alone = cost(shown(0.05)) + cost(shown(0.05), MOVED)
    assert cost(shown(0.05, views=2), CAMERA_PRIOR_SCALE, MOVED) == pytest.approx(alone / 2)


def test_a_given_camera_costs_nothing_wherever_it_stands():
    assert cost(standing(0.4, elevation=-0.5), KNOWN) == 0


def test_unlikely_viewpoints_weigh_more():
    azimuth, elevation = directions()
    probability = torch.full_like(azimuth, 1e-4)
    probability[30] = 1.0
    angles = torch.stack((azimuth[30] + torch.tensor([0.0, math.pi]), elevation[30].expand(2)), -1)[:, None]
    at = Parameters(angles, *(part.expand(2, *part.shape[1:]) for part in standing(0.0)[1:]))
    likely, unlikely = viewpoint_weights(at, [probability]).tolist()
    assert likely == pytest.approx(1, abs=1e-3)
    assert unlikely > 1.5
    assert viewpoint_weights(at, [None]).tolist() == [1, 1]


# Many hypotheses


def test_hypotheses_in_a_batch_are_judged_as_alone(tiny: Model):
    pixels, at = pixels_of(tiny, 64), parameters_of()
    together = evaluate_objective(tiny, at, pixels, 16, Objective(1e-4)).objective
    for index in range(3):
        one = Parameters(*(part[index : index + 1] for part in at))
        alone = evaluate_objective(tiny, one, pixels, 16, Objective(1e-4)).objective
        torch.testing.assert_close(alone[0], together[index], atol=1e-3, rtol=1e-2)  # bfloat16, in another order


def test_the_true_hypothesis_is_the_best(tiny: Model):
    at = parameters_of(4)
    at.angles[1, 0] = torch.tensor([0.5, 0.5])
    at.distance[1] = at.zoom[1] = 0
    at.shape[1] = tiny.codes.shape_space.coordinates(tiny.codes[0].shape)
    at.texture[1] = tiny.codes.texture_space.coordinates(tiny.codes[0].texture)
    assert int(evaluate_objective(tiny, at, pixels_of(tiny, 256), 32, Objective(0.0)).objective.argmin()) == 1


@pytest.mark.parametrize("wrong", [math.nan, -math.nan, math.inf])
@pytest.mark.parametrize("part", Parameters._fields)
def test_whatever_number_is_not_finite_the_objective_says_so(tiny: Model, part: str, wrong: float):
    """Rectifiers forget a NaN: it must show beside the field too."""
    at, pixels, stage = parameters_of(), pixels_of(tiny), Stage(3, 4, 96, 24, math.inf, 0.3)
    getattr(at, part)[1] = wrong
    with torch.no_grad():
        for found in (
            evaluate_objective(tiny, at, pixels, 24, Objective(1e-4)),
            normal_equations(tiny, at, pixels, None, stage, Objective(1e-4)),
        ):
            assert found.objective.isfinite().tolist() == [True, False, True]
