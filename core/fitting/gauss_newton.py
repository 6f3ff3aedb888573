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
from core.fitting.schedule import Stage
from core.geometry.camera import camera_rotation
from core.geometry.rays import Rays
from core.models.latents import Latents
from core.models.model import Model
from core.rendering.jacobian import render_with_jacobian
from core.runtime.pool import map_pieces

_MAX_STEP = (0.35, 0.35, 0.15, 0.15, 0.15, 0.1, 0.05, 0.05)
"""Largest step of each camera parameter (:data:`CAMERA_PARAMETERS`): beyond it, the quadratic is unreliable."""
_MAX_CODE_STEP = 3.0  # standard deviations
_EFFECTIVE_PIXELS = 64
"""Assumed number of independent errors in a photo: the uncertainty of right cameras then matches their error."""
_SAMPLES_PER_JACOBIAN = 11  # one sample in 11 is differentiated, on average
_NO_PIXELS = RenderedPixels(torch.empty(0))  # for terms of parameters


class NormalEquations(NamedTuple):
    """The objective of hypotheses, and its quadratic model around them.

    The order of parameters is that of :func:`core.fitting.hypotheses.to_vector`.
    """

    objective: Float[Tensor, "hypotheses"]
    squared_error: Float[Tensor, "hypotheses"]  # see ObjectiveValue
    gradient: Float[Tensor, "hypotheses parameters"]  # half of the gradient
    hessian: Float[Tensor, "hypotheses parameters parameters"]  # half of Gauss-Newton's Hessian


def gauss_newton_step(
    batch: HypothesisBatch, equations: NormalEquations, stage: Stage, free: Bool[Tensor, "views 8"]
) -> HypothesisBatch:
    """Return the hypotheses after one step, with the loss and squared error from before it.

    Args:
        equations: of these hypotheses.
        free: camera parameters that may move; codes always may.

    A hypothesis with a non-finite objective gets infinite loss and does not move.
    """
    step = _solve_damped(equations, stage, free)
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
    unknown: Bool[Tensor, "views"],
) -> float:
    """Return the uncertainty (rad) of the cameras' orientations within their basin, at most pi: that of the worst.

    The standard deviation from the objective's curvature (Laplace's approximation), marginalised over all other free
    parameters. Other arguments are those of :func:`normal_equations`.

    Args:
        hypothesis: a batch of one.
        free: camera parameters that may move.
        unknown: photos with unknown cameras, at least one.
    """
    equations = normal_equations(model, hypothesis.parameters, pixels, None, stage, objective)
    movable = _free_mask(equations, free, stage).nonzero()[:, 0]
    hessian = equations.hessian[0][movable][:, movable].double()
    variance = torch.zeros(equations.hessian.shape[1], dtype=torch.double)
    variance[movable] = torch.linalg.pinv(hessian, hermitian=True).diagonal()
    cameras = variance[: free.numel()].unflatten(0, free.shape)[unknown]
    of_angles = cameras[:, :2].sum(1).max()  # azimuth and elevation
    photos = len(free)  # whose errors are independent
    deviation = (equations.objective[0] * of_angles / (_EFFECTIVE_PIXELS * photos)).clamp_min(0).sqrt()
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
    """Return the quadratic model of the objective around hypotheses.

    Args:
        jitter: see :func:`core.fitting.hypotheses.hypothesis_rays`.
        stage: whose samples rays have.
        cells, origin: see :func:`core.fitting.objective.evaluate_objective`.
    """
    hypothesis_count = len(parameters.angles)
    pixel_count = pixels.pixels.shape[1]

    def evaluate(half: tuple[slice, slice]) -> NormalEquations:
        hypotheses, pixel_slice = half
        return _equations_of_half(
            model,
            Parameters(*(values[hypotheses] for values in parameters)),
            pixels.subset(pixel_slice),
            None if jitter is None else jitter.unflatten(1, (pixel_count, -1))[:, pixel_slice].flatten(1),
            stage,
            objective,
            cells if cells is None else cells[hypotheses],
            origin,
        )

    halves = _halves(hypothesis_count, pixel_count)
    columns = zip(*map_pieces(evaluate, halves), strict=True)
    if hypothesis_count % 2 == 0:
        equations = NormalEquations(*map(torch.cat, columns))
    else:
        weights = [len(range(pixel_count)[pixel_slice]) / pixel_count for _, pixel_slice in halves]
        equations = NormalEquations(*(sum(map(torch.mul, values, weights), torch.zeros(())) for values in columns))
    for term in (build(pixels, objective) for build in objective.terms):
        if term.channels is None:
            _add_prior(term, parameters, equations)
    return equations


def _halves(hypotheses: int, pixels: int) -> list[tuple[slice, slice]]:
    """Return the indices of hypotheses and pixels of a thread each: half of the pixels if hypotheses are odd."""
    everything = slice(None)
    if hypotheses % 2:  # every second pixel, as they are sorted: on the object, near it, elsewhere
        return [(everything, slice(first, None, 2)) for first in range(min(2, pixels))]
    middle = hypotheses // 2
    return [(slice(middle), everything), (slice(middle, None), everything)]


def _equations_of_half(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    jitter: Float[Tensor, "views all_rays"] | None,
    stage: Stage,
    objective: Objective,
    cells: Bool[Tensor, "hypotheses x y z"] | None,
    origin: Latents | None,
) -> NormalEquations:
    """Return :func:`normal_equations` without priors, in this thread."""
    rendered, jacobian = _render(model, parameters, pixels, jitter, stage, cells, origin)
    value = torch.zeros(len(jacobian))
    slope, curvature = torch.zeros(2, *rendered.channels.shape)
    for term in (build(pixels, objective) for build in objective.terms):
        if term.channels is not None:
            residual = term.residual(parameters, rendered)
            weights = residual_weights(term, residual)
            slope[..., term.channels] += weights * residual
            curvature[..., term.channels] += weights
            value += term_value(term, residual)
    rows = jacobian.flatten(1, -2)
    gradient = (slope.flatten(1)[:, None] @ rows)[:, 0]
    rows *= curvature.sqrt_().flatten(1)[..., None]
    hessian = rows.mT @ rows
    error = image_squared_error(rendered, pixels, objective.occluder_scale)
    return NormalEquations(value, error, gradient, hessian)


@torch.enable_grad()
def _add_prior(term: Term, parameters: Parameters, equations: NormalEquations) -> None:
    """Add a term of parameters to the equations, in place."""
    vector = to_vector(parameters).requires_grad_()
    residual = term.residual(from_vector(vector, parameters), _NO_PIXELS)
    value = residual.detach()
    weights = residual_weights(term, value)
    (slope,) = torch.autograd.grad((weights * value * residual).sum(), vector, retain_graph=True)
    (change,) = torch.autograd.grad((weights.sqrt() * residual).sum(), vector)
    equations.objective.add_(term_value(term, value))
    equations.gradient.add_(slope)
    equations.hessian.diagonal(dim1=1, dim2=2).add_(change.square())


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
    rays = hypothesis_rays(model, parameters, pixels, stage.samples, jitter)
    frame = render_with_jacobian(
        model,
        rays,
        stage.samples,
        max(2, stage.samples // _SAMPLES_PER_JACOBIAN),
        *hypothesis_biases(model, parameters, origin),
        bias_jacobians(model, parameters, origin),
        known_cells(model, cells),
    )
    by_camera = torch.cat((frame.origin, frame.direction), -1) @ camera_jacobian(parameters, rays)
    views = rays.near.shape[1]
    sizes = views * CAMERA_PARAMETERS, frame.shape.shape[-1], frame.texture.shape[-1]
    jacobian = torch.zeros(*frame.channels.shape, sum(sizes))
    cameras, shape, texture = jacobian.split(sizes, -1)
    own_camera = cameras.unflatten(-1, (views, -1)).diagonal(dim1=1, dim2=-2)  # a ray moves with its own camera only
    own_camera.copy_(by_camera.movedim(1, -1))
    shape.copy_(frame.shape)
    texture[..., : frame.texture.shape[-2], :] = frame.texture
    return RenderedPixels(pixels.mean_of_rays(frame.channels.cpu())), pixels.mean_of_rays(jacobian)


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


def _free_mask(equations: NormalEquations, free: Bool[Tensor, "views 8"], stage: Stage) -> Bool[Tensor, "parameters"]:
    """Mark the parameters that may move: the free ones of cameras, and all or none of the codes."""
    codes = equations.gradient.shape[1] - free.numel()
    return torch.cat((free.flatten(), torch.full((codes,), stage.codes_move)))


def _solve_damped(
    equations: NormalEquations, stage: Stage, free: Bool[Tensor, "views 8"]
) -> Float[Tensor, "hypotheses parameters"]:
    """Return the step to the minimum of the damped quadratic, limited in length; zero if not finite."""
    movable = _free_mask(equations, free, stage)
    gradient = equations.gradient * movable
    hessian = equations.hessian.clone()
    diagonal = hessian.diagonal(dim1=1, dim2=2)
    diagonal.mul_(1 + stage.damping).add_(1e-9)
    for fixed in (~movable).nonzero()[:, 0].tolist():
        hessian[:, fixed] = 0.0
        hessian[:, :, fixed] = 0.0
        diagonal[:, fixed] = 1.0
    # A row that is not finite shows on the diagonal, its squared length.
    finite = diagonal.isfinite().all(1) & gradient.isfinite().all(1)
    hessian[~finite] = torch.eye(len(movable))
    factor, failed = torch.linalg.cholesky_ex(hessian)
    finite = finite & (failed == 0)
    step = -torch.cholesky_solve(gradient[..., None], factor)[..., 0]
    step = step.where(finite[:, None], 0.0)
    longest = torch.tensor(_MAX_STEP * len(free) + (_MAX_CODE_STEP,) * (len(movable) - free.numel()))
    return step / (step.abs() / longest).amax(1, keepdim=True).clamp_min(1.0)


def _apply_step(
    parameters: Parameters, step: Float[Tensor, "hypotheses parameters"], free: Bool[Tensor, "views 8"]
) -> Parameters:
    """Return the parameters after a step, clamped to the searched range (:func:`clamp_parameters`)."""
    return clamp_parameters(from_vector(to_vector(parameters) + step, parameters), free.any(1))
