"""Damped Gauss-Newton (Levenberg-Marquardt) for many hypotheses at once.

The objective is a sum of weighted squares (:mod:`core.fitting.objective`), so the jacobian of its residuals gives a
quadratic model that is accurate near the minimum. Each step minimises the damped quadratic on new pixels, since fixed
pixels would be overfitted. Camera and codes move together, so steps can follow valleys in which one compensates the
other.
"""

import math
from collections.abc import Callable
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
from core.fitting.pieces import Piece, add_rays, cells_of
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
    vector, views = to_vector(parameters), len(pixels.pixels)
    value, gradient, hessian = (torch.zeros(len(vector), *[vector.shape[1]] * axes) for axes in range(3))
    sums = NormalEquations(value, torch.zeros_like(value), gradient, hessian)
    for prior in objective.priors:
        _add_prior(prior(pixels, objective), parameters, sums)
    render = _renderer(model, parameters, pixels, jitter, stage, cells, origin)

    def of_piece(piece: Piece) -> NormalEquations:
        some, _, index = piece
        seen, own = pixels.part(index), Parameters(*(part[some] for part in parameters))
        rendered, jacobian = render(piece, seen)
        shares = NormalEquations(*(torch.zeros_like(total[some]) for total in sums))
        for term in objective.terms:
            _add_term(term(seen, objective), own, rendered, jacobian, shares)
        shares.squared_error.copy_(image_squared_error(rendered, seen, objective.occluder_scale))
        return shares

    shape = len(vector), views, pixels.pixels.shape[1]
    add_rays(of_piece, sums, shape, stage.samples * pixels.footprints.shape[2])
    return sums


@torch.enable_grad()
def _add_term(
    term: Term,
    parameters: Parameters,
    rendered: RenderedPixels,
    jacobian: Float[Tensor, "hypotheses views rays channels parameters"],
    sums: NormalEquations,
) -> None:
    """Add a term of pixels, half of its gradient and its Gauss-Newton Hessian."""
    channels = rendered.channels.detach().requires_grad_()
    scaled, known = _scaled_residual(term, term.residual(parameters, RenderedPixels(channels)), sums)
    parts = [torch.autograd.grad(part.sum(), channels, retain_graph=True)[0] for part in scaled.unbind(-1)]
    rows = (torch.stack(parts, -2) @ jacobian).flatten(1, -2)  # each residual has its own pixel
    sums.gradient.add_((known.flatten(1)[:, None] @ rows)[:, 0])
    sums.hessian.baddbmm_(rows.mT, rows)


@torch.enable_grad()
def _add_prior(term: Term, parameters: Parameters, sums: NormalEquations) -> None:
    """Add a term of parameters like :func:`_add_term`."""
    vector = to_vector(parameters).requires_grad_()
    residual = term.residual(from_vector(vector, parameters), RenderedPixels(torch.empty(len(vector), 0, 0, 4)))
    scaled, known = _scaled_residual(term, residual, sums)
    parts = [torch.autograd.grad(part.sum(), vector, retain_graph=True)[0] for part in scaled.unbind(-1)]
    sums.gradient.add_(torch.autograd.grad((known * scaled).sum(), vector)[0])
    sums.hessian.diagonal(dim1=1, dim2=2).add_(torch.stack(parts).square().sum(0))  # each has its own parameter


def _scaled_residual(term: Term, residual: Tensor, sums: NormalEquations) -> tuple[Tensor, Tensor]:
    """Add a term's value; return its residuals times the roots of their weights, differentiable and detached."""
    value = residual.detach()
    root = residual_weights(term, value).sqrt()
    sums.objective.add_(term_value(term, value))
    return root * residual, root * value


_Renderer = Callable[[Piece, PixelBatch], tuple[RenderedPixels, Tensor]]


def _renderer(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    jitter: Float[Tensor, "views all_rays"] | None,
    stage: Stage,
    cells: Bool[Tensor, "hypotheses x y z"] | None,
    origin: Latents | None,
) -> _Renderer:
    """Return a function that renders a piece: its pixels, and the jacobian of their channels by all parameters."""
    entries, biases = bias_jacobians(model, parameters, origin), hypothesis_biases(model, parameters, origin)
    kept, cells = max(2, stage.samples // _SAMPLES_PER_JACOBIAN), known_cells(model, cells)
    rays = hypothesis_rays(model, parameters, pixels, stage.samples, jitter)
    moves = camera_jacobian(parameters, rays)

    def render(piece: Piece, seen: PixelBatch) -> tuple[RenderedPixels, Tensor]:
        some, views, index = piece
        which = some, views, pixels.rays_of(index)
        shape_bias, texture_bias, *along = (part[some] for part in (*biases, *entries))
        of_codes, own = BiasJacobians(*along), cells_of(cells, some)
        found = render_with_jacobian(model, rays[which], stage.samples, kept, shape_bias, texture_bias, of_codes, own)
        along_cameras = (torch.cat((found.origin, found.direction), -1) @ moves[which]).cpu()
        jacobian = torch.cat((_by_camera(along_cameras), found.codes.cpu()), -1)
        return RenderedPixels(seen.mean_of_rays(found.channels.cpu())), seen.mean_of_rays(jacobian)

    return render


def _by_camera(along: Float[Tensor, "hypotheses views rays channels 8"]) -> Tensor:
    """Return derivatives by the parameters of all cameras: a ray moves with its own camera only."""
    views = along.shape[1]
    if views == 1:
        return along
    spread = along.new_zeros(*along.shape[:-1], views, CAMERA_PARAMETERS)
    for view in range(views):
        spread[:, view, ..., view, :] = along[:, view]
    return spread.flatten(-2)


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
