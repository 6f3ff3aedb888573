"""Motions of an object's surface along the first shape directions, and edits that follow them.

Moved straight along a direction, the code of a fitted object leaves what the network was trained on: arms vanish, legs
come loose. Therefore an edit moves the surface only. A smooth velocity per direction, a polynomial of the place, is
fitted to the speed at which the network moves the surface along its normals. The biases of the shape blocks are then
solved for (Gauss-Newton) so that the edited field at a place is the field where that place came from. The code moves,
too, as it says how far the object was edited; offsets of the biases take up the difference.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.models.field import encode
from core.models.latents import Latents
from core.models.model import Instance, Model

DIRECTIONS = 6  # the first ones, which have words
LIMIT = 1.0  # standard deviations to either side, for objects as usual as the training objects
TERMS = [(x, y, z) for x in range(4) for y in range(4 - x) for z in range(4 - x - y)]  # exponents of the polynomials
_CANDIDATES, _POINTS = 40_000, 1500  # random places, and those that are kept beside the surface
_BESIDE = 2.0  # logit of such a place: the surface is at 0
_JITTERS = (0.012, 0.012, 0.05)  # scene units around surface points; at each, edited and original field are compared
_STEP = 0.5  # standard deviations to either side, for the speed of the surface
_SPEED = 0.04  # scene units per standard deviation: faster than this, a part appears or vanishes
_ROUNDS = 4  # of robust least squares
_RIDGE = 1e-4  # of the velocity's coefficients
_SUBSTEPS = 6  # along the velocity
_SOLVES = 3  # Gauss-Newton steps
_PRIOR = 0.2  # weight of the offsets' squares
_FIRMER = 0.8  # logits added where the object is solid, or nearly: thin parts must not come loose
_FIRM = -0.3  # logit from which a place counts as nearly solid
_FIRM_WEIGHT = 3.0
_SAME = 0.05, 1e-3  # greatest difference of equal offsets and of equal coordinates


class Warp(NamedTuple):
    """A smooth map from the places of an edited object to those of the object that it was made from."""

    extent: tuple[float, float, float]
    coefficients: tuple[tuple[float, float, float], ...]  # of a displacement in scene units, for each monomial

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places that points of the edited object came from."""
        return points + _monomials(points, points.new_tensor(self.extent)) @ points.new_tensor(self.coefficients)


class Motion(NamedTuple):
    """Points on an object's surface, and the velocity of their neighbourhood along the first shape directions."""

    surface: Float[Tensor, "points 3"]
    velocities: Float[Tensor, "directions terms 3"]  # scene units per standard deviation


def supports_motion(model: Model) -> bool:
    """Return False for the authors' checkpoints and for M1 and M2, whose codes move alone."""
    return not (model.white_from_network or model.is_ablation)


def moved_along(instance: Instance, direction: int, to: float) -> Instance:
    """Move an object along a shape direction to a coordinate, in standard deviations, or as far as it may go.

    Args:
        direction: index into :attr:`core.models.codes.CodeSpace.basis`.
    """
    model = instance.model
    space = model.codes.shape_space
    low, high = reach(instance, direction)
    if direction >= DIRECTIONS or not supports_motion(model):
        by = min(high, max(low, to)) - float(space.coordinates(instance.codes.shape)[direction])
        return instance.moved("shape", by * space.basis[direction])
    origin, steps = _origin(instance)
    start = float(space.coordinates(origin.shape)[direction])
    by = round(min(high, max(low, to)) - start, 4)
    shape, offsets = _edit(model, origin, (*steps[:direction], by, *steps[direction + 1 :]))
    return instance.changed(shape=shape, shape_offsets=offsets)


def reach(instance: Instance, direction: int) -> tuple[float, float]:
    """Return the ends of an object's way along a shape direction: coordinates in standard deviations.

    It is the same before and after edits. An object unlike the training objects breaks earlier, so its way is shorter.
    """
    space = instance.model.codes.shape_space
    origin = _origin(instance)[0] if supports_motion(instance.model) else instance.codes
    middle = float(space.coordinates(origin.shape)[direction])
    limit = LIMIT / max(1.0, float(space.distance(origin.shape)))
    return middle - limit, middle + limit


def warp_to_fitted(instance: Instance) -> Warp | None:
    """Return the map from an edited object to the object fitted to its photos.

    None if no place moved, and without photos.
    """
    model = instance.model
    if instance.detail is None or not supports_motion(model):
        return None
    fitted = instance.detail.fitted
    steps = _steps(model, fitted, instance.codes)
    return _warp(model, _untextured(fitted), steps) if any(steps) else None


def unmoved_distance(instance: Instance) -> float:
    """Return an object's distance from the shape of its photos, apart from what :func:`warp_to_fitted` follows.

    In standard deviations. Raises ``ValueError`` without photos.
    """
    space = instance.model.codes.shape_space
    away = space.coordinates(instance.codes.shape) - space.coordinates(instance.fitted.codes.shape)
    if supports_motion(instance.model):
        away[:DIRECTIONS] -= away[:DIRECTIONS].clamp(-LIMIT, LIMIT)
    return float(away.square().mean().sqrt())


def _steps(model: Model, origin: Latents, codes: Latents) -> tuple[float, ...]:
    space = model.codes.shape_space
    away = space.coordinates(codes.shape) - space.coordinates(origin.shape)
    return tuple(round(step, 4) for step in away[:DIRECTIONS].clamp(-LIMIT, LIMIT).tolist())


def _origin(instance: Instance) -> tuple[Latents, tuple[float, ...]]:
    """Return the shape that an object is an edit of, and the edit's steps; its own shape if that is unknown."""
    fitted = instance.detail and _untextured(instance.detail.fitted)
    return _origin_of(instance.model, _untextured(instance.codes), fitted)


@lru_cache(maxsize=64)
def _origin_of(model: Model, codes: Latents, fitted: Latents | None) -> tuple[Latents, tuple[float, ...]]:
    for origin in _candidates(model, codes, fitted):
        steps = _steps(model, origin, codes)
        shape, offsets = _edit(model, origin, steps)
        same_code = float(model.codes.shape_space.distance(shape, codes.shape)) < _SAME[1]
        if same_code and _offset_difference(offsets, codes.shape_offsets) < _SAME[0]:
            return origin, steps
    return codes, (0.0,) * min(DIRECTIONS, len(model.codes.shape_space.std))


def _candidates(model: Model, codes: Latents, fitted: Latents | None) -> Iterator[Latents]:
    """Yield the shapes fitted or trained that differ from codes in the first directions only."""
    rest = model.codes.shape_space.directions[DIRECTIONS:]
    if fitted is not None and float(((codes.shape - fitted.shape) @ rest.T).norm()) < _SAME[1]:
        yield fitted
    away = ((model.codes.shapes - codes.shape) @ rest.T).norm(dim=1)
    for index in (away < _SAME[1]).nonzero()[:, 0]:
        yield _untextured(Latents(model.codes.shapes[index], codes.texture))


def _offset_difference(first: Tensor | None, second: Tensor | None) -> float:
    if first is None or second is None:
        offsets = first if second is None else second
        return 0.0 if offsets is None else float(offsets.abs().amax())
    return float((first.float() - second.float()).abs().amax())


def _untextured(latents: Latents) -> Latents:
    """Return a shape alone, as a key of caches."""
    return Latents(latents.shape, torch.zeros_like(latents.texture), latents.shape_offsets)


@lru_cache(maxsize=64)
def _edit(model: Model, origin: Latents, steps: tuple[float, ...]) -> tuple[Tensor, Tensor | None]:
    """Return the shape's code and offsets after steps along the first directions (standard deviations)."""
    if not any(steps):
        return origin.shape, origin.shape_offsets
    with torch.inference_mode(False), torch.no_grad():  # cached
        warp = _warp(model, origin, steps)
        bias = model.biases(origin)[0]
        std = model.bias_std[0]
        bias = bias + std * _solve(model, bias, warp, _moved_points(model, origin, steps))
        shape = origin.shape + torch.tensor(steps) @ model.codes.shape_space.basis[: len(steps)]
        offsets = (bias - model.field.shape_bias(shape)) / std
    return shape, offsets.half().cpu()


def _solve(
    model: Model, bias: Float[Tensor, "blocks width"], warp: Warp, points: Float[Tensor, "points 3"]
) -> Float[Tensor, "blocks width"]:
    """Return the change of biases, in standard deviations, that gives points the field of their origins."""
    field = model.field
    std = model.bias_std[0]
    target_logits = _logits(model, warp.origins(points), bias)
    target_logits = target_logits + _FIRMER * torch.sigmoid(10 * (target_logits - _FIRM))
    weight = torch.where(target_logits > _FIRM, _FIRM_WEIGHT, 1.0)[:, None]
    first = _first_layer(model, points)
    change = torch.zeros_like(bias)
    for _ in range(_SOLVES):
        with torch.enable_grad():
            biases = (bias + change * std).expand(len(points), -1, -1).clone().requires_grad_(True)
            solid = torch.tanh(field.logits_from_activations(first, biases)[0] / 2)
            (jacobian,) = torch.autograd.grad(solid.sum(), biases)
        jacobian = (jacobian * std).flatten(1)
        residual = torch.tanh(target_logits / 2) - solid.detach()
        prior = _PRIOR / jacobian.shape[1]
        curvature = jacobian.T @ (weight * jacobian) / len(points) + prior * torch.eye(jacobian.shape[1])
        downhill = jacobian.T @ (weight[:, 0] * residual) / len(points) - prior * change.flatten()
        change = change + torch.linalg.solve(curvature, downhill).view_as(change)
    return change


@lru_cache(maxsize=64)
def _warp(model: Model, origin: Latents, steps: tuple[float, ...]) -> Warp:
    """Return the map back from an object moved by steps along the first directions (standard deviations)."""
    with torch.inference_mode(False), torch.no_grad():  # cached
        points = _points(motion(model, origin))
        moved = _moved_points(model, origin, steps)
        terms = _monomials(moved, model.extent_tensor)
        normal = terms.T @ terms + _RIDGE * len(points) * torch.eye(len(TERMS))
        coefficients = torch.linalg.solve(normal, terms.T @ (points - moved))
    return Warp(model.extent, tuple(map(tuple, coefficients.tolist())))


def _moved_points(model: Model, origin: Latents, steps: tuple[float, ...]) -> Float[Tensor, "points 3"]:
    place = motion(model, origin)
    extent = model.extent_tensor
    velocity = torch.einsum("d,dtc->tc", torch.tensor(steps), place.velocities)
    points = _points(place)
    for _ in range(_SUBSTEPS):
        points = points + _monomials(points, extent) @ velocity / _SUBSTEPS
    return points


def _points(place: Motion) -> Float[Tensor, "points 3"]:
    """Return random points around an object's surface, the same at every call."""
    generator = torch.Generator().manual_seed(1)
    shifts = [jitter * torch.randn(place.surface.shape, generator=generator) for jitter in _JITTERS]
    return torch.cat([place.surface + shift for shift in shifts])


@lru_cache(maxsize=8)
def motion(model: Model, origin: Latents) -> Motion:
    """Measure the motion of an object's surface; cached. The object's texture does not matter."""
    with torch.inference_mode(False), torch.no_grad():  # cached
        surface, normals = _surface(model, origin)
        bias = model.biases(origin)[0]
        offsets = bias - model.field.shape_bias(origin.shape)
        space = model.codes.shape_space
        rows = (normals[:, :, None] * _monomials(surface, model.extent_tensor)[:, None]).flatten(1)
        slope = _slopes(model, surface, bias).norm(dim=-1).clamp_min(1e-3)
        velocities = []
        for step in space.basis[:DIRECTIONS]:
            ends = [origin.shape + side * _STEP * step for side in (1, -1)]
            more, less = (_logits(model, surface, offsets + model.field.shape_bias(end)) for end in ends)
            velocities.append(_velocity(rows, (more - less) / (2 * _STEP * slope)))
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


def _surface(model: Model, origin: Latents) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Return random points on an object's surface, and its outward normals there."""
    generator = torch.Generator().manual_seed(0)
    extent = model.extent_tensor
    bias = model.biases(origin)[0]
    points = (2 * torch.rand(_CANDIDATES, 3, generator=generator) - 1) * extent
    if model.occupied_cells is not None:
        cells = model.occupied_cells.nonzero()
        chosen = cells[torch.randint(len(cells), (_CANDIDATES,), generator=generator)]
        side = 2 / model.occupied_cells.shape[0]
        points = ((chosen + torch.rand(chosen.shape, generator=generator)) * side - 1) * extent
    logits = _logits(model, points, bias)
    order = (logits.abs() + 1e3 * (logits.abs() > _BESIDE)).argsort()
    points = points[order[: max(_POINTS, int((logits.abs() < _BESIDE).sum()))]]
    points = points[torch.randperm(len(points), generator=generator)[:_POINTS]]
    slopes = _slopes(model, points, bias)
    towards = _logits(model, points, bias) / slopes.square().sum(-1).clamp_min(1.0)
    points = points - (towards[:, None] * slopes).clamp(-0.03, 0.03)
    return points, -functional.normalize(_slopes(model, points, bias), dim=-1)


def _logits(
    model: Model, points: Float[Tensor, "points 3"], bias: Float[Tensor, "blocks width"]
) -> Float[Tensor, "points"]:
    return model.field.logits_from_activations(_first_layer(model, points), bias)[0]


def _first_layer(model: Model, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points width"]:
    return model.field.point_layer(encode(points, model.field.config.position_frequencies)).relu()


def _slopes(
    model: Model, points: Float[Tensor, "points 3"], bias: Float[Tensor, "blocks width"]
) -> Float[Tensor, "points 3"]:
    """Return the gradients of the logits at points."""
    with torch.enable_grad():
        points = points.detach().clone().requires_grad_(True)
        (slopes,) = torch.autograd.grad(_logits(model, points, bias).sum(), points)
    return slopes


def _monomials(points: Float[Tensor, "*batch 3"], extent: Float[Tensor, "3"]) -> Float[Tensor, "*batch terms"]:
    place = (points / extent).clamp(-1, 1)
    x, y, z = torch.stack([place**power for power in range(4)]).unbind(-1)
    return torch.stack([x[a] * y[b] * z[c] for a, b, c in TERMS], -1)
