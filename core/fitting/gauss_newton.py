"""Damped Gauss-Newton (Levenberg and Marquardt) for many hypotheses at once.

Eq. 5 is a sum of squares (of weighted ones, where it forgives), so the slopes of its residuals make a quadratic that
is right near its minimum. Its minimum, damped, is the next guess, and other pixels say where to go from there: asked
again and again, the same ones lead into holes that are theirs alone. Camera and codes move together, so that the
valleys in which one makes up for the other are walked along and not across.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

from core.fitting.hypotheses import (
    SILHOUETTE,
    STRAY_PRIORS,
    Numbers,
    Objective,
    Pool,
    aimed,
    astray,
    forgiven,
    strays,
    within_bounds,
)
from core.fitting.observations import Drawn
from core.fitting.schedule import Stage
from core.geometry.camera import camera_rotation
from core.geometry.rays import Rays
from core.models.model import Model
from core.models.precision import matmul_dtype
from core.rendering.jacobian import BiasJacobians, render_with_jacobian

_CAMERA = 6
"""numbers of a camera: azimuth, elevation, logarithms of distance and focal length, shift x and y"""
_LONGEST = (0.35, 0.35, 0.15, 0.15, 0.05, 0.05)
"""A step moves none of them by more: beyond, the quadratic says nothing."""
_LONGEST_CODE = 3.0
"""standard deviations"""
_INDEPENDENT = 64
"""Errors of a picture's pixels that have nothing to do with each other: so many that right cameras are about as far off
as their spread."""
_KEPT = 11
"""One of so many samples of a ray goes into the slopes."""


class Quadratic(NamedTuple):
    """The objective of hypotheses, and what it is like around them."""

    objective: Float[Tensor, "hypotheses"]
    squared: Float[Tensor, "hypotheses"]
    """as in :class:`core.fitting.hypotheses.Judged`"""
    slope: Float[Tensor, "hypotheses numbers"]
    """half the gradient along the cameras' numbers, view by view, and those of shape and texture"""
    bend: Float[Tensor, "hypotheses numbers numbers"]
    """half the Hessian, as Gauss and Newton see it"""


def stride(
    model: Model, pool: Pool, drawn: Drawn, jitter: Tensor, stage: Stage, by: Objective, free: Bool[Tensor, "views 6"]
) -> Pool:
    """One step of every hypothesis towards what these pixels say; its cost and squared error are those before it.

    Args:
        jitter: as for :func:`core.fitting.hypotheses.judged`.
        free: which numbers of which camera may move.

    A hypothesis whose objective is not finite gets infinite cost and stays where it is.
    """
    around = quadratic(model, pool.numbers, drawn, jitter, stage, by)
    ranks, movable = _movable(pool, stage, free)
    numbers = _moved(pool.numbers, _step(around, stage.damping, movable, free.numel()), ranks, free)
    cost = around.objective.nan_to_num(math.inf, math.inf)
    return replace(pool, numbers=numbers, cost=cost, squared=around.squared)


def tried(
    model: Model,
    one: Pool,
    drawn: Drawn,
    stage: Stage,
    by: Objective,
    free: Bool[Tensor, "views 6"],
    choices: Sequence[tuple[int, int]],
) -> Numbers:
    """Where one step takes a single hypothesis if only so many directions of shape and texture move: for each choice.

    The other arguments are those of :func:`stride`; no choice is beyond the stage's own directions.
    """
    around = quadratic(model, one.numbers, drawn, None, stage, by)
    (shapes, textures), movable = _movable(one, stage, free)
    moved = []
    for shape, texture in choices:
        few = movable.clone()
        few[free.numel() + shape : free.numel() + shapes] = False
        few[free.numel() + shapes + texture :] = False
        step = _step(around, stage.damping, few, free.numel())
        moved.append(_moved(one.numbers, step, (shapes, textures), free))
    return Numbers(*(torch.cat(parts) for parts in zip(*moved, strict=True)))


def spread(
    model: Model, one: Pool, drawn: Drawn, stage: Stage, by: Objective, free: Bool[Tensor, "views 6"], view: int
) -> float:
    """How far, in rad, the direction of a single hypothesis' camera may be off within its basin.

    The standard deviation that the objective's curvature leaves it (Laplace's approximation), where all that is free
    to move makes up for its error as well as it can. The other arguments are those of :func:`stride`.
    """
    around = quadratic(model, one.numbers, drawn, None, stage, by)
    movable = _movable(one, stage, free)[1].nonzero()[:, 0]
    bend = around.bend[0][movable][:, movable].double()
    angles = ((movable == view * _CAMERA) | (movable == view * _CAMERA + 1)).nonzero()[:, 0]
    known = torch.linalg.pinv(bend, hermitian=True)[angles][:, angles].trace()
    found = (around.objective[0] * known / _INDEPENDENT).clamp_min(0).sqrt().nan_to_num(math.pi, math.pi)
    return min(float(found), math.pi)


def _movable(
    pool: Pool, stage: Stage, free: Bool[Tensor, "views 6"]
) -> tuple[tuple[int, int], Bool[Tensor, "numbers"]]:
    """How many numbers of shape and texture a stage moves, and which of all the numbers of its quadratics."""
    ranks = min(stage.ranks[0], pool.numbers.shape.shape[1]), min(stage.ranks[1], pool.numbers.texture.shape[1])
    return ranks, torch.cat((free.flatten(), torch.ones(sum(ranks), dtype=torch.bool)))


def quadratic(
    model: Model, numbers: Numbers, drawn: Drawn, jitter: Tensor | None, stage: Stage, by: Objective
) -> Quadratic:
    """The objective around hypotheses, of the numbers that a stage moves."""
    rays = aimed(model, numbers, drawn, stage.samples, jitter)
    shapes, textures = by.spaces(model)
    shape, texture = shapes.code(numbers.shape), textures.code(numbers.texture)
    dtype = matmul_dtype(model.device.type)
    entries = BiasJacobians(
        model.field.shape_bias_jacobian(shape, shapes.basis(stage.ranks[0])).to(dtype),
        model.field.texture_bias_jacobian(texture, textures.basis(stage.ranks[1])).to(dtype),
    )
    biases = model.field.biases(shape, texture)
    seen = render_with_jacobian(model, rays, stage.samples, max(2, stage.samples // _KEPT), *biases, entries)
    count, views, pixels = rays.near.shape
    jacobian = torch.zeros(count, views, pixels, 4, views * _CAMERA + seen.codes.shape[-1])
    for index, (origins, directions) in enumerate(_aims(numbers, rays)):
        along = (seen.origin * origins[..., None, :] + seen.direction * directions[..., None, :]).sum(-1).cpu()
        for view in range(views):
            jacobian[:, view, ..., view * _CAMERA + index] = along[:, view]
    jacobian[..., views * _CAMERA :] = seen.codes.cpu()
    error = seen.colour.cpu() - drawn.colours
    residual = torch.cat((error, (seen.opacity.cpu() - drawn.opaque)[..., None]), -1)
    squared = error.square().mean(-1)
    weight = torch.full((count, views, pixels, 4), 1 / (3 * views * pixels))
    weight[..., :3] /= (1 + squared / by.forgiving**2)[..., None]  # Cauchy's loss, reweighted as it bends
    weight[..., 3] = 0.0 if model.white_from_network else SILHOUETTE * drawn.sure / (views * pixels)
    objective = forgiven(squared, by).mean((1, 2)) + (residual[..., 3].square() * weight[..., 3]).sum((1, 2))
    jacobian, residual = (jacobian * weight.sqrt()[..., None]).flatten(1, 3), (residual * weight.sqrt()).flatten(1)
    fit = Quadratic(
        objective,
        (squared * drawn.shares).sum((1, 2)) / views,
        (residual[:, None] @ jacobian)[:, 0],
        jacobian.mT @ jacobian,
    )
    codes = torch.cat((numbers.shape[:, : stage.ranks[0]], numbers.texture[:, : stage.ranks[1]]), -1)
    return _with_priors(fit, numbers, codes, by)


def _with_priors(fit: Quadratic, numbers: Numbers, codes: Tensor, by: Objective) -> Quadratic:
    """With what makes codes and cameras unlikely; the latter grows with a logarithm, reweighted as it bends."""
    away, spreads = strays(numbers), by.spreads
    pull = torch.tensor(STRAY_PRIORS) / spreads**2 / (1 + (away / spreads).square()) / away.shape[1]
    pulls, where = (torch.zeros(*away.shape[:2], _CAMERA) for _ in range(2))
    pulls[..., 1:4], where[..., 1:4] = pull * (away != 0), away
    pulls = torch.cat((pulls.flatten(1), torch.full_like(codes, by.prior)), -1)
    unlikely = numbers.shape.square().sum(-1) + numbers.texture.square().sum(-1)
    objective = fit.objective + by.prior * unlikely + astray(numbers, by)
    slope = fit.slope + pulls * torch.cat((where.flatten(1), codes), -1)
    return fit._replace(objective=objective, slope=slope, bend=fit.bend + torch.diag_embed(pulls))


def _aims(numbers: Numbers, rays: Rays) -> tuple[tuple[Tensor, Tensor], ...]:
    """How the rays' origins and directions change with each number of their camera; (hypotheses, views, rays, 3)."""
    origins, directions = rays.origins, rays.directions
    right, up, backward = camera_rotation(*numbers.angles.to(origins.device).unbind(-1))[:, :, None].unbind(-2)
    vertical, still = torch.tensor([0.0, 0.0, 1.0], device=origins.device).expand_as(right), torch.zeros_like(origins)
    shortened = -(directions * backward).sum(-1, keepdim=True)
    lens = numbers.zoom.exp().to(origins.device)[..., None, None]

    def aside(axis: Tensor) -> Tensor:
        """A direction through a place in the picture that moves by a focal length."""
        return shortened * (axis - directions * (directions * axis).sum(-1, keepdim=True))

    return (
        (torch.linalg.cross(vertical, origins), torch.linalg.cross(vertical, directions)),
        (torch.linalg.cross(origins, right), torch.linalg.cross(directions, right)),
        (origins, still),
        (origins, -aside(backward)),
        (still, -aside(right) / lens),
        (still, aside(up) / lens),
    )


def _step(around: Quadratic, damping: float, movable: Bool[Tensor, "numbers"], cameras: int) -> Tensor:
    """To the minimum of the damped quadratic, but not beyond what it can know; nowhere where it is not finite.

    (hypotheses, numbers); the first ``cameras`` numbers are those of cameras.
    """
    still = torch.eye(len(movable))
    own = around.bend.diagonal(dim1=1, dim2=2)
    bend = around.bend + torch.diag_embed(own * damping + 1e-9)
    bend = torch.where(movable[:, None] & movable, bend, still)
    slope = around.slope * movable
    sound = bend.flatten(1).isfinite().all(1) & slope.isfinite().all(1)
    factor, failed = torch.linalg.cholesky_ex(torch.where(sound[:, None, None], bend, still))
    sound = sound & (failed == 0)
    factor = torch.where(sound[:, None, None], factor, still)
    step = -torch.cholesky_solve(slope.where(sound[:, None], 0.0)[..., None], factor)[..., 0]
    longest = torch.tensor(_LONGEST * (cameras // _CAMERA) + (_LONGEST_CODE,) * (len(movable) - cameras))
    return step / (step.abs() / longest).amax(1, keepdim=True).clamp_min(1.0)


def _moved(numbers: Numbers, step: Tensor, ranks: tuple[int, int], free: Bool[Tensor, "views 6"]) -> Numbers:
    """A step further, within what cameras can be."""
    camera, shape, texture = step.split((step.shape[1] - sum(ranks), *ranks), 1)
    camera = camera.reshape(*numbers.distance.shape, _CAMERA)
    moved = Numbers(
        numbers.angles + camera[..., :2],
        numbers.distance + camera[..., 2],
        numbers.zoom + camera[..., 3],
        numbers.shift + camera[..., 4:],
        numbers.shape + pad(shape, (0, numbers.shape.shape[1] - ranks[0])),
        numbers.texture + pad(texture, (0, numbers.texture.shape[1] - ranks[1])),
    )
    return within_bounds(moved, free.any(1))
