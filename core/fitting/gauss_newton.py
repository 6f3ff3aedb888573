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
    one: HypothesisBatch,
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
        one: a single hypothesis.
        view: the photo of the camera.
    """
    equations = normal_equations(model, one.parameters, pixels, None, stage, objective)
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
    vector, channels = to_vector(parameters).requires_grad_(), rendered.channels.detach().requires_grad_()
    residual = term.residual(from_vector(vector, parameters), RenderedPixels(channels))
    value = residual.detach()
    root = residual_weights(term, value).sqrt()
    scaled, known = root * residual, root * value
    of = vector, channels
    parts = [torch.autograd.grad(part.sum(), of, retain_graph=True, allow_unused=True) for part in scaled.unbind(-1)]
    by_vector, by_channels = zip(*parts, strict=True)
    if by_vector[0] is not None:  # each residual has its own parameter
        gradient += torch.autograd.grad((known * scaled).sum(), vector, retain_graph=True)[0]
        hessian.diagonal(dim1=1, dim2=2).add_(torch.stack(by_vector).square().sum(0))
    if by_channels[0] is not None:  # each residual has its own pixel
        rows = (torch.stack(by_channels, -2) @ jacobian).flatten(1, -2)
        gradient += (known.flatten(1)[:, None] @ rows)[:, 0]
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
    entries, biases = bias_jacobians(model, parameters, origin), hypothesis_biases(model, parameters, origin)
    kept, cells = max(2, stage.samples // _SAMPLES_PER_JACOBIAN), known_cells(model, cells)

    rays = hypothesis_rays(model, parameters, pixels, stage.samples, jitter)
    moves = camera_jacobian(parameters, rays)

    def render(piece: Piece) -> tuple[Tensor, Tensor]:
        shape_bias, texture_bias, *along = (part[piece[0]] for part in (*biases, *entries))
        of_codes, own = BiasJacobians(*along), cells_of(cells, piece[0])
        seen = render_with_jacobian(model, rays[piece], stage.samples, kept, shape_bias, texture_bias, of_codes, own)
        along_cameras = torch.cat((seen.origin, seen.direction), -1) @ moves[piece]
        return seen.channels.cpu(), torch.cat((along_cameras, seen.codes), -1).cpu()

    channels, along = map_rays(render, rays.near.shape, stage.samples)
    views, codes = rays.near.shape[1], along.shape[-1] - CAMERA_PARAMETERS
    jacobian = torch.zeros(*along.shape[:-1], views * CAMERA_PARAMETERS + codes)
    for view in range(views):  # a ray moves with its own camera only
        first = view * CAMERA_PARAMETERS
        jacobian[:, view, ..., first : first + CAMERA_PARAMETERS] = along[:, view, ..., :CAMERA_PARAMETERS]
    jacobian[..., views * CAMERA_PARAMETERS :] = along[..., CAMERA_PARAMETERS:]
    return RenderedPixels(pixels.mean_of_rays(channels)), pixels.mean_of_rays(jacobian)


def camera_jacobian(parameters: Parameters, rays: Rays) -> Float[Tensor, "hypotheses views rays 6 8"]:
    """Return the derivative of each ray's origin and direction with respect to its camera's parameters."""
    origins, directions = rays.origins, rays.directions
    right, up, backward = camera_rotation(*parameters.angles.to(origins.device).unbind(-1))[:, :, None].unbind(-2)
    vertical, still = torch.tensor([0.0, 0.0, 1.0], device=origins.device).expand_as(right), torch.zeros_like(origins)
    forward = -(directions * backward).sum(-1, keepdim=True)
    crop_transform, zoom = parameters.crop_transform.to(origins.device), parameters.zoom.to(origins.device)
    focal = (zoom + crop_transform[..., 0]).exp()[..., None, None]
    cos, sin = crop_transform[..., 1].cos()[..., None, None], crop_transform[..., 1].sin()[..., None, None]

    def across(axis: Tensor) -> Tensor:
        """Return the derivative of a direction whose image point moves along an axis, per focal length."""
        return forward * (axis - directions * (directions * axis).sum(-1, keepdim=True))

    closer = -across(backward)
    pairs = (
        (torch.linalg.cross(vertical, origins), torch.linalg.cross(vertical, directions)),
        (torch.linalg.cross(origins, right), torch.linalg.cross(directions, right)),
        (origins, still),
        (origins, closer),
        (still, closer),
        (still, torch.linalg.cross(backward.expand_as(directions), directions)),
        (still, -across(cos * right + sin * up) / focal),
        (still, across(cos * up - sin * right) / focal),
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
