"""Damped Gauss-Newton (Levenberg-Marquardt) for many hypotheses at once.

The objective is a sum of weighted squares (:mod:`core.fitting.objective`), so the jacobian of its residuals gives a
quadratic model that is accurate near the minimum. Each step minimises the damped quadratic on new pixels, since fixed
pixels would be overfitted. Camera and codes move together, so steps can follow valleys in which one compensates the
other.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.biases import bias_jacobians, hypothesis_biases
from core.fitting.hypotheses import (
    CAMERA_PARAMETERS,
    HypothesisBatch,
    Parameters,
    clamp_parameters,
    from_vector,
    hypothesis_rays,
    known_cells,
    to_vector,
)
from core.fitting.objective import Objective, RenderedPixels, Term, image_squared_error, residual_weights, term_value
from core.fitting.observations import PixelBatch
from core.fitting.pieces import Piece, cells_of, map_rays
from core.fitting.schedule import Stage
from core.geometry.camera import camera_rotation
from core.geometry.rays import Rays
from core.models.latents import Latents
from core.models.model import Model
from core.rendering.jacobian import BiasJacobians, render_with_jacobian

_MAX_STEP = (0.35, 0.35, 0.15, 0.15, 0.15, 0.1, 0.05, 0.05)
"""Largest step of each camera parameter (:data:`CAMERA_PARAMETERS`): beyond it, the quadratic is unreliable."""
_MAX_CODE_STEP = 3.0  # standard deviations
_EFFECTIVE_PIXELS = 64
"""Assumed number of independent errors in a photo: the uncertainty of right cameras then matches their error."""
_SAMPLES_PER_JACOBIAN = 11  # one sample in 11 is differentiated, on average


class NormalEquations(NamedTuple):
    """The objective of hypotheses, and its quadratic model around them.

    The order of parameters is that of :func:`core.fitting.hypotheses.to_vector`.
    """

    objective: Float[Tensor, "hypotheses"]
    squared_error: Float[Tensor, "hypotheses"]  # see ObjectiveValue
    gradient: Float[Tensor, "hypotheses parameters"]  # half of the gradient
    hessian: Float[Tensor, "hypotheses parameters parameters"]  # half of Gauss-Newton's Hessian


def gauss_newton_step(
    model: Model,
    batch: HypothesisBatch,
    pixels: PixelBatch,
    jitter: Float[Tensor, "views all_rays"],
    stage: Stage,
    objective: Objective,
    free: Bool[Tensor, "views 8"],
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
    origin: Latents | None = None,
) -> HypothesisBatch:
    """Return the hypotheses after one step, with the loss and squared error from before it.

    Args:
        jitter: see :func:`core.fitting.hypotheses.hypothesis_rays`.
        free: camera parameters that may move; codes always may.
        cells, origin: see :func:`core.fitting.objective.evaluate_objective`.

    A hypothesis with a non-finite objective gets infinite loss and does not move.
    """
    equations = normal_equations(model, batch.parameters, pixels, jitter, stage, objective, cells, origin)
    step = _solve_damped(equations, stage.damping, free)
    parameters = _apply_step(batch.parameters, step, free)
    loss = equations.objective.nan_to_num(math.inf, math.inf)
    return replace(batch, parameters=parameters, loss=loss, squared_error=equations.squared_error)


def camera_uncertainty(
    model: Model,
    hypothesis: HypothesisBatch,
    pixels: PixelBatch,
    stage: Stage,
    objective: Objective,
    free: Bool[Tensor, "views 8"],
    view: int,
) -> float:
    """Return the uncertainty (rad) of a camera's orientation within its basin, at most pi.

    The standard deviation from the objective's curvature (Laplace's approximation), marginalised over all other free
    parameters. Other arguments are those of :func:`gauss_newton_step`.

    Args:
        hypothesis: a batch of one.
        view: the photo of the camera.
    """
    equations = normal_equations(model, hypothesis.parameters, pixels, None, stage, objective)
    movable = _free_mask(equations, free).nonzero()[:, 0]
    hessian = equations.hessian[0][movable][:, movable].double()
    first = view * CAMERA_PARAMETERS  # azimuth, then elevation
    angles = ((movable == first) | (movable == first + 1)).nonzero()[:, 0]
    variance = torch.linalg.pinv(hessian, hermitian=True)[angles][:, angles].trace()
    deviation = (equations.objective[0] * variance / _EFFECTIVE_PIXELS).clamp_min(0).sqrt()
    return min(float(deviation.nan_to_num(math.pi, math.pi)), math.pi)


def normal_equations(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    jitter: Float[Tensor, "views all_rays"] | None,
    stage: Stage,
    objective: Objective,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
    origin: Latents | None = None,
) -> NormalEquations:
    """Return the quadratic model of the objective around hypotheses; arguments as in :func:`gauss_newton_step`."""
    terms = [term(pixels, objective) for term in objective.terms]
    rendered, jacobian = _render(model, parameters, pixels, jitter, stage, cells, origin)
    value, gradient, hessian = (torch.zeros(len(jacobian), *[jacobian.shape[-1]] * axes) for axes in range(3))
    for term in terms:
        value += _add_term(term, parameters, rendered, jacobian, gradient, hessian)
    error = image_squared_error(rendered, pixels, objective.occluder_scale)
    return NormalEquations(value, error, gradient, hessian)


@torch.enable_grad()
def _add_term(
    term: Term,
    parameters: Parameters,
    rendered: RenderedPixels,
    jacobian: Float[Tensor, "hypotheses views rays channels parameters"],
    gradient: Float[Tensor, "hypotheses parameters"],
    hessian: Float[Tensor, "hypotheses parameters parameters"],
) -> Float[Tensor, "hypotheses"]:
    """Add half of a term's gradient and Gauss-Newton Hessian to ``gradient`` and ``hessian``; return its value."""
    inputs = to_vector(parameters).requires_grad_(), rendered.channels.detach().requires_grad_()
    residual = term.residual(from_vector(inputs[0], parameters), RenderedPixels(inputs[1]))
    value = residual.detach()
    root = residual_weights(term, value).sqrt()
    weighted = root * residual
    weighted_value = root * value
    grads = [torch.autograd.grad(c.sum(), inputs, retain_graph=True, allow_unused=True) for c in weighted.unbind(-1)]
    by_vector, by_channels = zip(*grads, strict=True)
    if by_vector[0] is not None:  # each residual has its own parameter
        gradient += torch.autograd.grad((weighted_value * weighted).sum(), inputs[0], retain_graph=True)[0]
        hessian.diagonal(dim1=1, dim2=2).add_(torch.stack(by_vector).square().sum(0))
    if by_channels[0] is not None:  # each residual has its own pixel
        rows = (torch.stack(by_channels, -2) @ jacobian).flatten(1, -2)
        gradient += (weighted_value.flatten(1)[:, None] @ rows)[:, 0]
        hessian.baddbmm_(rows.mT, rows)
    return term_value(term, value)


def _render(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    jitter: Float[Tensor, "views all_rays"] | None,
    stage: Stage,
    cells: Bool[Tensor, "hypotheses x y z"] | None,
    origin: Latents | None,
) -> tuple[RenderedPixels, Float[Tensor, "hypotheses views rays channels parameters"]]:
    """Render the pixels; return them with the jacobian of their channels with respect to all parameters."""
    bias_values = (*hypothesis_biases(model, parameters, origin), *bias_jacobians(model, parameters, origin))
    differentiated = max(2, stage.samples // _SAMPLES_PER_JACOBIAN)
    cells = known_cells(model, cells)
    rays = hypothesis_rays(model, parameters, pixels, stage.samples, jitter)
    ray_jacobian = camera_jacobian(parameters, rays)

    def render(piece: Piece) -> tuple[Tensor, Tensor]:
        shape_bias, texture_bias, *by_parameters = (values[piece[0]] for values in bias_values)
        jacobians = BiasJacobians(*by_parameters)
        piece_cells = cells_of(cells, piece[0])
        frame = render_with_jacobian(
            model, rays[piece], stage.samples, differentiated, shape_bias, texture_bias, jacobians, piece_cells
        )
        by_camera = torch.cat((frame.origin, frame.direction), -1) @ ray_jacobian[piece]
        return frame.channels.cpu(), torch.cat((by_camera, frame.codes), -1).cpu()

    channels, by_ray = map_rays(render, rays.near.shape, stage.samples)
    cameras = rays.near.shape[1] * CAMERA_PARAMETERS
    jacobian = torch.zeros(*by_ray.shape[:-1], cameras + by_ray.shape[-1] - CAMERA_PARAMETERS)
    for view, first in enumerate(range(0, cameras, CAMERA_PARAMETERS)):  # a ray moves with its own camera only
        jacobian[:, view, ..., first : first + CAMERA_PARAMETERS] = by_ray[:, view, ..., :CAMERA_PARAMETERS]
    jacobian[..., cameras:] = by_ray[..., CAMERA_PARAMETERS:]
    return RenderedPixels(pixels.mean_of_rays(channels)), pixels.mean_of_rays(jacobian)


def camera_jacobian(parameters: Parameters, rays: Rays) -> Float[Tensor, "hypotheses views rays 6 8"]:
    """Return the derivative of each ray's origin and direction with respect to its camera's parameters."""
    origins = rays.origins
    directions = rays.directions
    angles, zoom, crop = (
        values.to(origins.device) for values in (parameters.angles, parameters.zoom, parameters.crop_transform)
    )
    right, up, backward = camera_rotation(*angles.unbind(-1))[:, :, None].unbind(-2)
    vertical = torch.tensor([0.0, 0.0, 1.0], device=origins.device).expand_as(right)
    zero = torch.zeros_like(origins)
    forward = -(directions * backward).sum(-1, keepdim=True)
    focal = (zoom + crop[..., 0]).exp()[..., None, None]
    roll = crop[..., 1, None, None]
    cos = roll.cos()
    sin = roll.sin()

    def across(axis: Tensor) -> Tensor:
        """Return the derivative of a direction whose image point moves along an axis, per focal length."""
        return forward * (axis - directions * (directions * axis).sum(-1, keepdim=True))

    closer = -across(backward)
    pairs = (
        (torch.linalg.cross(vertical, origins), torch.linalg.cross(vertical, directions)),
        (torch.linalg.cross(origins, right), torch.linalg.cross(directions, right)),
        (origins, zero),
        (origins, closer),
        (zero, closer),
        (zero, torch.linalg.cross(backward.expand_as(directions), directions)),
        (zero, -across(cos * right + sin * up) / focal),
        (zero, across(cos * up - sin * right) / focal),
    )
    return torch.stack([torch.cat(pair, -1) for pair in pairs], -1)


def _free_mask(equations: NormalEquations, free: Bool[Tensor, "views 8"]) -> Bool[Tensor, "parameters"]:
    """Mark the parameters that may move: the free ones of cameras, and all of the codes."""
    codes = equations.gradient.shape[1] - free.numel()
    return torch.cat((free.flatten(), torch.ones(codes, dtype=torch.bool)))


def _solve_damped(
    equations: NormalEquations, damping: float, free: Bool[Tensor, "views 8"]
) -> Float[Tensor, "hypotheses parameters"]:
    """Return the step to the minimum of the damped quadratic, limited in length; zero if not finite."""
    movable = _free_mask(equations, free)
    identity = torch.eye(len(movable))
    diagonal = equations.hessian.diagonal(dim1=1, dim2=2)
    hessian = equations.hessian + torch.diag_embed(diagonal * damping + 1e-9)
    hessian = torch.where(movable[:, None] & movable, hessian, identity)
    gradient = equations.gradient * movable
    finite = hessian.flatten(1).isfinite().all(1) & gradient.isfinite().all(1)
    factor, failed = torch.linalg.cholesky_ex(torch.where(finite[:, None, None], hessian, identity))
    finite = finite & (failed == 0)
    factor = torch.where(finite[:, None, None], factor, identity)
    step = -torch.cholesky_solve(gradient.where(finite[:, None], 0.0)[..., None], factor)[..., 0]
    longest = torch.tensor(_MAX_STEP * len(free) + (_MAX_CODE_STEP,) * (len(movable) - free.numel()))
    return step / (step.abs() / longest).amax(1, keepdim=True).clamp_min(1.0)


def _apply_step(
    parameters: Parameters, step: Float[Tensor, "hypotheses parameters"], free: Bool[Tensor, "views 8"]
) -> Parameters:
    """Return the parameters after a step, clamped to the searched range (:func:`clamp_parameters`)."""
    return clamp_parameters(from_vector(to_vector(parameters) + step, parameters), free.any(1))
