"""Motions of an object's surface along the first shape directions, and edits that follow them.

Moved straight along a direction, the code of a fitted object leaves what the network was trained on: arms vanish, legs
come loose. Therefore an edit keeps the code and moves space. A smooth velocity per direction, a polynomial of the
place, is fitted to the speed at which the network moves the surface along its normals, less what would move the bounds
of the object. The edited field at a place is the field where that place came from, so no edit breaks an object.
"""

from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.edits.edit import Edit
from core.edits.warp import MAX_STEPS, TERMS, Warp, monomials
from core.models.field import encode
from core.models.latents import Latents
from core.models.model import Instance, Model
from core.models.network import with_network
from core.runtime.modes import usual_settings

DIRECTIONS = MAX_STEPS  # the first ones, which have words
LIMIT = 3.0  # standard deviations to either side
FOLLOWED = 1.0  # of a code's own way, which photos follow
_CANDIDATES, _POINTS = 40_000, 1500  # random places, and those that are kept beside the surface
_BESIDE = 2.0  # logit of such a place: the surface is at 0
_JITTERS = (0.012, 0.012, 0.05)  # scene units around surface points, for the way back
_STEP = 0.5  # standard deviations to either side, for the speed of the surface
_SPEED = 0.04  # scene units per standard deviation: faster than this, a part appears or vanishes
_ROUNDS = 4  # of robust least squares
_END = 0.03  # fraction of the surface's points at an end of the object
_UNITS = (1, 0, 0), (0, 1, 0), (0, 0, 1)  # exponents of the coordinates
_STRAIN = 0.6  # greatest growth of lengths, at the end of a direction and of several: space must not fold
_NEARLY_ALL = 0.98
_RIDGE = 1e-4  # of the velocity's coefficients
_SUBSTEPS = 6  # along the velocity


class Motion(NamedTuple):
    """Points on an object's surface, and the velocity of their neighbourhood along the first shape directions."""

    surface: Float[Tensor, "points 3"]
    velocities: Float[Tensor, "directions terms 3"]  # scene units per standard deviation


def position(instance: Instance, direction: int) -> float:
    """Return an object's coordinate along a shape direction: that of its code and its move, in standard deviations."""
    code = float(_coordinates(instance)[direction])
    steps = _steps(instance)
    return code + (steps[direction] if direction < len(steps) else 0.0)


def moved_along(instance: Instance, direction: int, to: float) -> Instance:
    """Move an object along a shape direction to a coordinate, in standard deviations, or as far as it may go.

    Args:
        direction: index into :attr:`core.models.codes.CodeSpace.basis`.
    """
    low, high = reach(instance, direction)
    by = min(high, max(low, to)) - position(instance, direction)
    if direction >= DIRECTIONS or not instance.model.supports_motion:
        return instance.moved("shape", by * instance.model.codes.shape_space.basis[direction])
    steps = list(_steps(instance))
    steps[direction] = round(steps[direction] + by, 4)
    return moved_by(instance, tuple(steps))


def moved_by(instance: Instance, steps: tuple[float, ...]) -> Instance:
    """Return the object that its code says, moved by steps along the first shape directions (standard deviations)."""
    warps = [_warp(instance.model, instance.codes.untextured, steps)] if any(steps) else []
    return instance.with_edits(Warp, *warps)


def _steps(instance: Instance) -> tuple[float, ...]:
    """Return how far edits have moved an object along the first shape directions, in standard deviations."""
    unmoved = (0.0,) * min(MAX_STEPS, len(instance.model.codes.shape_space.std))
    return next((warp.steps for warp in instance.codes.of_kind(Warp)), unmoved)


def prepare_motion(instance: Instance) -> None:
    """Measure what moves of an object need, a tenth of a second; cached, so that a drag begins at once."""
    if instance.model.supports_motion:
        motion(instance.model, instance.codes.untextured)


def reach(instance: Instance, direction: int) -> tuple[float, float]:
    """Return the ends of an object's way along a shape direction: coordinates in standard deviations.

    It is the same before and after edits. A code that moves alone goes as far from the mean.
    """
    code = float(_coordinates(instance)[direction])
    if direction >= DIRECTIONS or not instance.model.supports_motion:
        return min(-LIMIT, code), max(LIMIT, code)
    return code - LIMIT, code + LIMIT


def edits_to_fitted(instance: Instance) -> tuple[Edit, ...]:
    """Return the edits of space that lead from the object fitted to the photos to this one.

    They are the object's own, whose warp also follows a short way of its code.
    """
    model = instance.model
    if instance.detail is None or not model.supports_motion:
        return instance.codes.space_edits
    away = _coordinates(instance) - _coordinates(instance.fitted)
    followed = tuple(round(step, 4) for step in away[:DIRECTIONS].clamp(-FOLLOWED, FOLLOWED).tolist())
    if not any(followed):
        return instance.codes.space_edits
    steps = map(sum, zip(followed, _steps(instance), strict=True))
    warp = _warp(model, instance.detail.fitted.untextured, tuple(steps))
    return instance.codes.with_edits(Warp, warp).space_edits


def unmoved_distance(instance: Instance) -> float:
    """Return an object's distance from the shape of its photos, apart from what :func:`edits_to_fitted` follows.

    In standard deviations. Raises ``ValueError`` without photos.
    """
    away = _coordinates(instance) - _coordinates(instance.fitted)
    if instance.model.supports_motion:
        away[:DIRECTIONS] -= away[:DIRECTIONS].clamp(-FOLLOWED, FOLLOWED)
    return float(away.square().mean().sqrt())


def _coordinates(instance: Instance) -> Float[Tensor, "rank"]:
    return instance.model.codes.shape_space.coordinates(instance.codes.shape)


@lru_cache(maxsize=64)
def _warp(model: Model, origin: Latents, steps: tuple[float, ...]) -> Warp:
    """Return the map back from an object moved by steps along the first directions (standard deviations)."""
    with usual_settings(), torch.no_grad():  # cached
        extent = model.extent_tensor
        surface, velocities = motion(model, origin)
        velocity = torch.einsum("d,dtc->tc", torch.tensor(steps), velocities)
        strain = _strain(velocity, surface, extent)
        velocity = velocity * min(1.0, _STRAIN / strain)  # several moves together end no later than one
        points = _points(surface)
        moved = points
        for _ in range(_SUBSTEPS):
            moved = moved + monomials(moved, extent) @ velocity / _SUBSTEPS
        terms = monomials(moved, extent)
        normal = terms.T @ terms + _RIDGE * len(points) * torch.eye(len(TERMS))
        coefficients = torch.linalg.solve(normal, terms.T @ (points - moved))
    return Warp(steps, model.extent, tuple(map(tuple, coefficients.tolist())), min(strain, _STRAIN))


def _points(surface: Float[Tensor, "points 3"]) -> Float[Tensor, "places 3"]:
    """Return random points around an object's surface, the same at every call."""
    generator = torch.Generator().manual_seed(1)
    shifts = [jitter * torch.randn(surface.shape, generator=generator) for jitter in _JITTERS]
    return torch.cat([surface + shift for shift in shifts])


@lru_cache(maxsize=8)
def motion(model: Model, origin: Latents) -> Motion:
    """Measure the motion of an object's surface; cached. The object's texture does not matter."""
    with usual_settings(), torch.no_grad():  # cached
        surface, normals = _surface(model, origin)
        bias = model.biases(origin)[0]
        network = with_network(model, origin)
        offsets = bias - model.field.shape_bias(origin.shape)
        space = model.codes.shape_space
        rows = (normals[:, :, None] * monomials(surface, model.extent_tensor)[:, None]).flatten(1)
        slope = _slopes(network, surface, bias).norm(dim=-1).clamp_min(1e-3)
        velocities = []
        for step in space.basis[:DIRECTIONS]:
            ends = [origin.shape + side * _STEP * step for side in (1, -1)]
            more, less = (_logits(network, surface, offsets + model.field.shape_bias(end)) for end in ends)
            velocity = _velocity(rows, (more - less) / (2 * _STEP * slope))
            velocity = _within_bounds(velocity, surface, model.extent_tensor)
            velocities.append(velocity * min(1.0, _STRAIN / (LIMIT * _strain(velocity, surface, model.extent_tensor))))
    return Motion(surface, torch.stack(velocities))


def _velocity(rows: Float[Tensor, "points numbers"], speed: Float[Tensor, "points"]) -> Float[Tensor, "terms 3"]:
    """Return the polynomials whose normal component is nearest to a surface's speed, outwards; outliers count less."""
    roughness = torch.tensor([0.1 + sum(term) ** 2 for term in TERMS]).repeat(3)
    weight = torch.ones_like(speed)
    for _ in range(_ROUNDS):
        normal = rows.T @ (weight[:, None] * rows) + torch.diag(_RIDGE * len(rows) * roughness)
        numbers = torch.linalg.solve(normal, rows.T @ (weight * speed))
        weight = 1 / (1 + ((speed - rows @ numbers) / _SPEED) ** 2)
    return numbers.view(3, -1).T


def _within_bounds(
    velocity: Float[Tensor, "terms 3"], surface: Float[Tensor, "points 3"], extent: Float[Tensor, "3"]
) -> Float[Tensor, "terms 3"]:
    """Return a velocity less the shift and the growth along each axis that move the surface's two ends."""
    velocity = velocity.clone()
    unit_points = surface / extent
    for axis in range(3):
        order = unit_points[:, axis].argsort()
        count = max(1, round(_END * len(order)))
        low, high = (unit_points[ends] for ends in (order[:count], order[-count:]))
        speeds = [float((monomials(end * extent, extent) @ velocity[:, axis]).mean()) for end in (low, high)]
        middles = [float(end[:, axis].mean()) for end in (low, high)]
        growth = (speeds[1] - speeds[0]) / max(middles[1] - middles[0], 1e-6)
        velocity[TERMS.index((0, 0, 0)), axis] -= speeds[0] - growth * middles[0]
        velocity[TERMS.index(_UNITS[axis]), axis] -= growth
    return velocity


def _strain(
    velocity: Float[Tensor, "terms 3"], surface: Float[Tensor, "points 3"], extent: Float[Tensor, "3"]
) -> float:
    """Return the growth of lengths per standard deviation at nearly all of a surface, above 0."""
    with torch.enable_grad():
        points = surface.detach().clone().requires_grad_(True)
        speed = (monomials(points, extent.clone()) @ velocity).unbind(-1)
        slopes = [torch.autograd.grad(part.sum(), points, retain_graph=True)[0] for part in speed]
    return float(torch.stack(slopes).square().sum((0, 2)).sqrt().quantile(_NEARLY_ALL).clamp_min(1e-6))


def _surface(model: Model, origin: Latents) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Return random points on an object's surface, and its outward normals there."""
    generator = torch.Generator().manual_seed(0)
    extent = model.extent_tensor
    bias = model.biases(origin)[0]
    network = with_network(model, origin)
    points = (2 * torch.rand(_CANDIDATES, 3, generator=generator) - 1) * extent
    if model.occupied_cells is not None:
        cells = model.occupied_cells.nonzero()
        sampled = cells[torch.randint(len(cells), (_CANDIDATES,), generator=generator)]
        side = 2 / model.occupied_cells.shape[0]
        points = ((sampled + torch.rand(sampled.shape, generator=generator)) * side - 1) * extent
    logits = _logits(network, points, bias)
    order = (logits.abs() + 1e3 * (logits.abs() > _BESIDE)).argsort()
    points = points[order[: max(_POINTS, int((logits.abs() < _BESIDE).sum()))]]
    points = points[torch.randperm(len(points), generator=generator)[:_POINTS]]
    slopes = _slopes(network, points, bias)
    towards = _logits(network, points, bias) / slopes.square().sum(-1).clamp_min(1.0)
    points = points - (towards[:, None] * slopes).clamp(-0.03, 0.03)
    return points, -functional.normalize(_slopes(network, points, bias), dim=-1)


def _logits(
    model: Model, points: Float[Tensor, "points 3"], bias: Float[Tensor, "blocks width"]
) -> Float[Tensor, "points"]:
    first = model.field.point_layer(encode(points, model.field.config.position_frequencies)).relu()
    return model.field.logits_from_activations(first, bias)[0]


def _slopes(
    model: Model, points: Float[Tensor, "points 3"], bias: Float[Tensor, "blocks width"]
) -> Float[Tensor, "points 3"]:
    """Return the gradients of the logits at points."""
    with torch.enable_grad():
        points = points.detach().clone().requires_grad_(True)
        (slopes,) = torch.autograd.grad(_logits(model, points, bias).sum(), points)
    return slopes
