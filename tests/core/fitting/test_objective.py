"""The objective and its quadratic by autograd, and what each of its terms costs."""

import math

import pytest
import torch

from core.classifiers.viewpoint import directions
from core.fitting.gauss_newton import normal_equations
from core.fitting.hypotheses import Parameters, from_vector, to_vector
from core.fitting.objective import (
    CAMERA_PRIOR_SCALE,
    MOVED_SCALE,
    OCCLUDER_SCALE,
    Objective,
    RenderedPixels,
    Term,
    camera_prior_term,
    evaluate_objective,
    image_squared_error,
    mask_term,
    term_value,
    viewpoint_weights,
)
from core.fitting.observations import PixelBatch
from core.fitting.schedule import Stage
from core.models.model import Model
from core.rendering.folded_layers import AxisLookup
from core.runtime.precision import use_dtype
from tests.core.fitting.inputs import pixels_of, random_parameters, standing

KNOWN = (math.inf,) * 7
MOVED = (*CAMERA_PRIOR_SCALE[:3], MOVED_SCALE, CAMERA_PRIOR_SCALE[4], math.inf, math.inf)


def check_gradient(model: Model, at: Parameters, pixels: PixelBatch, objective: Objective) -> None:
    """Gauss-Newton's against autograd's. With two samples a ray, all of them are differentiated by both."""
    stage = Stage(3, 1, 96, 2, objective.robust_scale, 0.3)
    at = Parameters(*(part.requires_grad_() for part in at))
    with use_dtype(torch.float32):
        found = normal_equations(model, Parameters(*(part.detach() for part in at)), pixels, None, stage, objective)
        expected = evaluate_objective(model, at, pixels, stage.samples, objective)
    torch.testing.assert_close(found.objective, expected.objective, rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(found.squared_error, expected.squared_error, rtol=1e-4, atol=1e-7)
    vector = to_vector(Parameters(*(part.detach() for part in at)))
    rendered = RenderedPixels(torch.zeros(len(vector), *pixels.target_opacity.shape, 5))
    for term in (term(pixels, objective) for term in objective.terms):
        # Of two parameters, or two of one, Gauss-Newton would have a wrong Hessian.
        def residual(vector: torch.Tensor, term: Term = term) -> torch.Tensor:
            return term.residual(from_vector(vector, at), rendered)

        moves = torch.autograd.functional.jacobian(residual, vector)
        own = torch.stack([(moves[index, ..., index, :] != 0).flatten(0, -3) for index in range(len(vector))])
        assert int(own.sum(-1).max()) <= 1
        assert int(own.sum(1).max()) <= 1
    parts = torch.autograd.grad(expected.objective.sum(), at)
    gradient = torch.cat([part.flatten(1) for part in parts], 1)
    torch.testing.assert_close(2 * found.gradient, gradient, rtol=1e-4, atol=1e-4 * float(gradient.abs().max()))
    assert bool((torch.linalg.eigvalsh(found.hessian.double()) > -1e-9).all())


@pytest.fixture
def exact(monkeypatch: pytest.MonkeyPatch):
    """Without tables of the first layer, which are off in the fourth digit."""
    monkeypatch.setattr(AxisLookup, "__call__", AxisLookup.evaluate)


@pytest.mark.usefixtures("exact")
@pytest.mark.parametrize(
    ("robust_scale", "occluder_scale", "elevation", "scale_is_expected"),
    [  # every pair of values of two of them
        (math.inf, math.inf, 0.5, False),
        (math.inf, OCCLUDER_SCALE, -0.3, True),
        (0.2, math.inf, 0.5, True),
        (0.2, OCCLUDER_SCALE, -0.3, False),
        (0.02, math.inf, -0.3, True),
        (0.02, OCCLUDER_SCALE, 0.5, False),
    ],
)
def test_gauss_newton_sees_the_objective_and_its_gradient(
    tiny: Model, robust_scale: float, occluder_scale: float, elevation: float, scale_is_expected: bool
):
    expected = torch.linspace(-0.5, 0.5, len(directions()[0]))[None] if scale_is_expected else None
    at = random_parameters(elevation=elevation)
    at.crop_transform[:] = torch.tensor([0.1, -0.02, 0.03, 0.01])
    objective = Objective(1e-4, expected_scale=expected, robust_scale=robust_scale, occluder_scale=occluder_scale)
    check_gradient(tiny, at, pixels_of(tiny), objective)


def test_hypotheses_that_cost_nothing_are_not_held(tiny: Model):
    """A camera where it is expected has no curvature from its prior; elsewhere it has."""
    pixels, objective = pixels_of(tiny), Objective(0.0, terms=(camera_prior_term,))
    for distance, held in ((0.0, False), (0.1, True)):
        found = normal_equations(tiny, standing(distance), pixels, None, Stage(1, 1, 96, 2, math.inf, 0.3), objective)
        assert bool(found.hessian.any()) == held


def test_something_in_front_may_hide_an_object_but_not_show_one(tiny: Model):
    """Where the object is expected beside its mask a saturated price is paid; where it lacks, all of it."""
    pixels = pixels_of(tiny)
    strict, lenient = Objective(1e-4), Objective(1e-4, occluder_scale=OCCLUDER_SCALE)
    beside = (pixels.target_opacity < 0.5).float().expand(1, 1, -1)

    def black(opacity: torch.Tensor) -> RenderedPixels:
        return RenderedPixels(torch.cat((torch.zeros(*opacity.shape, 3), opacity[..., None]), -1))

    def price(opacity: torch.Tensor, objective: Objective) -> float:
        term = mask_term(pixels, objective)
        return float(term_value(term, term.residual(random_parameters(1), black(opacity))))

    extra, lacking = torch.maximum(pixels.target_opacity, 0.9 * beside), 0.1 * pixels.target_opacity[None]
    assert price(extra, lenient) < 0.3 * price(extra, strict)
    assert price(lacking, lenient) == pytest.approx(price(lacking, strict))
    seen = image_squared_error(black(extra), pixels, OCCLUDER_SCALE)
    assert float(seen) < float(image_squared_error(black(extra), pixels))


# What a camera costs


def shown(scale: float, right: float = 0.0, views: int = 1) -> Parameters:
    crop_transform = torch.tensor([scale, 0.0, right, 0.0]).expand(1, views, 4)
    return standing(0.0, views=views)._replace(crop_transform=crop_transform)


def cost(at: Parameters, *scales: tuple[float, ...], expected: torch.Tensor | None = None) -> float:
    some = torch.zeros(at.distance.shape[1], 1, 2)
    pixels = PixelBatch(some, torch.zeros(*some.shape[:2], 3), *[some[..., 0]] * 3, some[..., None, :], some[..., 0])
    term = camera_prior_term(
        pixels, Objective(1e-4, torch.tensor(scales or [CAMERA_PRIOR_SCALE]), expected_scale=expected)
    )
    return float(term_value(term, term.residual(at, RenderedPixels(torch.zeros(1, *some.shape[:2], 4)))))


def test_cameras_where_they_are_expected_cost_nothing():
    assert cost(standing(0.0)) == 0
    assert cost(standing(0.0, elevation=-0.2)) > 0
    assert cost(standing(0.0, zoom=0.4)) > 0
    assert cost(standing(0.4, elevation=-0.5), KNOWN) == 0
    expected = torch.zeros(1, len(directions()[0])).add_(0.4)
    assert cost(shown(0.4), expected=expected) == pytest.approx(0, abs=1e-6)
    assert cost(shown(0.0), expected=expected) > 1e-3


def test_every_photo_has_a_scale_of_its_own_and_a_moved_one_says_less():
    assert 0 < cost(shown(0.05), MOVED) < cost(shown(0.05)) / 2
    assert cost(shown(0.0, right=0.2), MOVED) == 0 < cost(shown(0.0, right=0.02))
    alone = cost(shown(0.05)) + cost(shown(0.05), MOVED)
    assert cost(shown(0.05, views=2), CAMERA_PRIOR_SCALE, MOVED) == pytest.approx(alone / 2)


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
    pixels, at = pixels_of(tiny, 64), random_parameters()
    together = evaluate_objective(tiny, at, pixels, 16, Objective(1e-4)).objective
    for index in range(3):
        one = Parameters(*(part[index : index + 1] for part in at))
        alone = evaluate_objective(tiny, one, pixels, 16, Objective(1e-4)).objective
        torch.testing.assert_close(alone[0], together[index], atol=1e-3, rtol=1e-2)  # bfloat16, in another order


@pytest.mark.parametrize("wrong", [math.nan, -math.nan, math.inf])
@pytest.mark.parametrize("part", Parameters._fields)
def test_whatever_number_is_not_finite_the_objective_says_so(tiny: Model, part: str, wrong: float):
    """Rectifiers forget a NaN: it must show beside the field too."""
    at, pixels, stage = random_parameters(), pixels_of(tiny), Stage(3, 4, 96, 24, math.inf, 0.3)
    getattr(at, part)[1] = wrong
    with torch.no_grad():
        for found in (
            evaluate_objective(tiny, at, pixels, 24, Objective(1e-4)),
            normal_equations(tiny, at, pixels, None, stage, Objective(1e-4)),
        ):
            assert found.objective.isfinite().tolist() == [True, False, True]
