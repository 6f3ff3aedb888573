"""The objective, its quadratic model against autograd, and the values of its terms."""

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
    render_pixels,
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


def check_value(model: Model, parameters: Parameters, pixels: PixelBatch, stage: Stage, objective: Objective) -> None:
    """Check a term alone, so that a failure names it: its value is an average over pixels, of its channels' errors."""
    (build,) = objective.terms
    term = build(pixels, objective)
    rendered = render_pixels(model, parameters, pixels, stage.samples)
    if term.channels is not None:
        channels = rendered.channels[..., term.channels].shape
        assert term.residual(parameters, rendered).shape == channels, f"{build.__name__}: components are no channels"
    equations = normal_equations(model, parameters, pixels, None, stage, objective)
    expected = evaluate_objective(model, parameters, pixels, stage.samples, objective)
    assert torch.allclose(equations.objective, expected.objective, rtol=1e-4, atol=1e-7), (
        f"{build.__name__}: no average over pixels"
    )


def check_gradient(model: Model, parameters: Parameters, pixels: PixelBatch, objective: Objective) -> None:
    """Gauss-Newton's against autograd's. With two samples a ray, all of them are differentiated by both."""
    stage = Stage(3, 1, 96, 2, objective.robust_scale, 0.3)
    parameters = Parameters(*(values.requires_grad_() for values in parameters))
    detached = Parameters(*(values.detach() for values in parameters))
    with use_dtype(torch.float32):
        for term in objective.terms:
            check_value(model, detached, pixels, stage, objective._replace(terms=(term,)))
        equations = normal_equations(model, detached, pixels, None, stage, objective)
        expected = evaluate_objective(model, parameters, pixels, stage.samples, objective)
    torch.testing.assert_close(equations.objective, expected.objective, rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(equations.squared_error, expected.squared_error, rtol=1e-4, atol=1e-7)
    vector = to_vector(detached)
    rendered = RenderedPixels(torch.zeros(len(vector), *pixels.target_opacity.shape, 5))
    for term in (term(pixels, objective) for term in objective.terms):
        # Of two parameters, or two of one, Gauss-Newton would have a wrong Hessian.
        def residual(vector: torch.Tensor, term: Term = term) -> torch.Tensor:
            return term.residual(from_vector(vector, parameters), rendered)

        moves = torch.autograd.functional.jacobian(residual, vector)
        dependent = torch.stack([(moves[index, ..., index, :] != 0).flatten(0, -3) for index in range(len(vector))])
        assert int(dependent.sum(-1).max()) <= 1
        assert int(dependent.sum(1).max()) <= 1
    gradients = torch.autograd.grad(expected.objective.sum(), parameters)
    gradient = torch.cat([gradient.flatten(1) for gradient in gradients], 1)
    torch.testing.assert_close(2 * equations.gradient, gradient, rtol=1e-4, atol=1e-4 * float(gradient.abs().max()))
    assert bool((torch.linalg.eigvalsh(equations.hessian.double()) > -1e-9).all())


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
def test_normal_equations_have_the_objective_and_gradient_of_autograd(
    tiny: Model, robust_scale: float, occluder_scale: float, elevation: float, scale_is_expected: bool
):
    expected = torch.linspace(-0.5, 0.5, len(directions()[0]))[None] if scale_is_expected else None
    parameters = random_parameters(elevation=elevation)
    parameters.crop_transform[:] = torch.tensor([0.1, -0.02, 0.03, 0.01])
    objective = Objective(1e-4, expected_scale=expected, robust_scale=robust_scale, occluder_scale=occluder_scale)
    check_gradient(tiny, parameters, pixels_of(tiny), objective)


def test_a_camera_prior_of_zero_adds_no_curvature(tiny: Model):
    """A camera where it is expected has no curvature from its prior; elsewhere it has."""
    pixels = pixels_of(tiny)
    stage = Stage(1, 1, 96, 2, math.inf, 0.3)
    objective = Objective(0.0, terms=(camera_prior_term,))
    for distance, held in ((0.0, False), (0.1, True)):
        equations = normal_equations(tiny, standing(distance), pixels, None, stage, objective)
        assert bool(equations.hessian.any()) == held


def test_the_occluder_scale_reduces_the_loss_only_outside_the_mask(tiny: Model):
    """Rendered opacity outside the mask has a saturated loss; missing opacity inside it has the full loss."""
    pixels = pixels_of(tiny)
    strict = Objective(1e-4)
    lenient = Objective(1e-4, occluder_scale=OCCLUDER_SCALE)
    background = (pixels.target_opacity < 0.5).float().expand(1, 1, -1)

    def black(opacity: torch.Tensor) -> RenderedPixels:
        return RenderedPixels(torch.cat((torch.zeros(*opacity.shape, 3), opacity[..., None]), -1))

    def loss(opacity: torch.Tensor, objective: Objective) -> float:
        term = mask_term(pixels, objective)
        return float(term_value(term, term.residual(random_parameters(1), black(opacity))))

    occluding = torch.maximum(pixels.target_opacity, 0.9 * background)
    lacking = 0.1 * pixels.target_opacity[None]
    assert loss(occluding, lenient) < 0.3 * loss(occluding, strict)
    assert loss(lacking, lenient) == pytest.approx(loss(lacking, strict))
    error = image_squared_error(black(occluding), pixels, OCCLUDER_SCALE)
    assert float(error) < float(image_squared_error(black(occluding), pixels))


# Camera prior


def cropped(scale: float, right: float = 0.0, views: int = 1) -> Parameters:
    crop_transform = torch.tensor([scale, 0.0, right, 0.0]).expand(1, views, 4)
    return standing(0.0, views=views)._replace(crop_transform=crop_transform)


def cost(parameters: Parameters, *scales: tuple[float, ...], expected: torch.Tensor | None = None) -> float:
    points = torch.zeros(parameters.distance.shape[1], 1, 2)
    pixels = PixelBatch(
        points, torch.zeros(*points.shape[:2], 3), *[points[..., 0]] * 3, points[..., None, :], points[..., 0]
    )
    term = camera_prior_term(
        pixels, Objective(1e-4, torch.tensor(scales or [CAMERA_PRIOR_SCALE]), expected_scale=expected)
    )
    return float(term_value(term, term.residual(parameters, RenderedPixels(torch.zeros(1, *points.shape[:2], 4)))))


def test_expected_cameras_have_no_prior_loss():
    assert cost(standing(0.0)) == 0
    assert cost(standing(0.0, elevation=-0.2)) > 0
    assert cost(standing(0.0, zoom=0.4)) > 0
    assert cost(standing(0.4, elevation=-0.5), KNOWN) == 0
    expected = torch.zeros(1, len(directions()[0])).add_(0.4)
    assert cost(cropped(0.4), expected=expected) == pytest.approx(0, abs=1e-6)
    assert cost(cropped(0.0), expected=expected) > 1e-3


def test_every_photo_has_its_own_scale_and_a_moved_one_a_wider_one():
    assert 0 < cost(cropped(0.05), MOVED) < cost(cropped(0.05)) / 2
    assert cost(cropped(0.0, right=0.2), MOVED) == 0 < cost(cropped(0.0, right=0.02))
    alone = cost(cropped(0.05)) + cost(cropped(0.05), MOVED)
    assert cost(cropped(0.05, views=2), CAMERA_PRIOR_SCALE, MOVED) == pytest.approx(alone / 2)


def test_unlikely_viewpoints_have_larger_weights():
    azimuth, elevation = directions()
    probability = torch.full_like(azimuth, 1e-4)
    probability[30] = 1.0
    angles = torch.stack((azimuth[30] + torch.tensor([0.0, math.pi]), elevation[30].expand(2)), -1)[:, None]
    parameters = Parameters(angles, *(values.expand(2, *values.shape[1:]) for values in standing(0.0)[1:]))
    likely, unlikely = viewpoint_weights(parameters, [probability]).tolist()
    assert likely == pytest.approx(1, abs=1e-3)
    assert unlikely > 1.5
    assert viewpoint_weights(parameters, [None]).tolist() == [1, 1]


# Many hypotheses


def test_a_batch_has_the_objectives_of_its_hypotheses(tiny: Model):
    pixels = pixels_of(tiny, 64)
    parameters = random_parameters()
    together = evaluate_objective(tiny, parameters, pixels, 16, Objective(1e-4)).objective
    for index in range(3):
        alone_parameters = Parameters(*(values[index : index + 1] for values in parameters))
        alone = evaluate_objective(tiny, alone_parameters, pixels, 16, Objective(1e-4)).objective
        torch.testing.assert_close(alone[0], together[index], atol=1e-3, rtol=1e-2)  # bfloat16, in another order


@pytest.mark.parametrize("wrong", [math.nan, -math.nan, math.inf])
@pytest.mark.parametrize("field", Parameters._fields)
def test_nonfinite_parameters_give_a_nonfinite_objective(tiny: Model, field: str, wrong: float):
    """Rectifiers forget a NaN: it must show beside the field too."""
    parameters = random_parameters()
    pixels = pixels_of(tiny)
    stage = Stage(3, 4, 96, 24, math.inf, 0.3)
    getattr(parameters, field)[1] = wrong
    with torch.no_grad():
        for value in (
            evaluate_objective(tiny, parameters, pixels, 24, Objective(1e-4)),
            normal_equations(tiny, parameters, pixels, None, stage, Objective(1e-4)),
        ):
            assert value.objective.isfinite().tolist() == [True, False, True]
