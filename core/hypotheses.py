"""Hypotheses of what pictures show: a camera for each and one pair of codes, many of them in one batch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.camera import Camera, rotation
from core.codes import Codes, CodeSpace
from core.model import Model
from core.precision import autocast
from core.rays import Rays, cast
from core.sparse import render_seen
from core.targets import Drawn

_SILHOUETTE = 0.1
"""The squared error of opacity against that of colour."""
_DISTANCE_SPREAD = 0.05
"""How far the logarithm of the distance strays from that of the training pictures before it costs much."""
_DISTANCE_PRIOR = 2e-3
"""Against the squared error of a pixel; grows with the logarithm only, so that a picture can insist."""
_BASIN = math.radians(25)
"""Cameras that differ by less mostly end at the same place."""
_STEEPEST = math.radians(89.9)
_ADAM = (0.9, 0.98, 0.0)
"""Its decays, short as the fit is, and that of the numbers themselves: there is none."""
_ADAMW = (0.9, 0.999, 0.01)
"""The usual ones, which the paper's authors kept."""


class Numbers(NamedTuple):
    """All that is searched for.

    Azimuth and elevation are regular at the pole as they stand: an upright camera that looks at the origin turns by
    the same angle for the same step of either everywhere, and above the pole its azimuth is the roll of the picture.
    (It is the direction on the sphere that is not: there, every direction has pictures of any roll beside it.)
    """

    angles: Float[Tensor, "hypotheses views 2"]
    """azimuth, elevation; rad"""
    distance: Float[Tensor, "hypotheses views"]
    """logarithm of the distance over the model's"""
    shift: Float[Tensor, "hypotheses views 2"]
    """of the optical axis in the picture, x right and y down, in focal lengths; 0 unless a picture was reframed"""
    shape: Float[Tensor, "hypotheses shape_rank"]
    """standard deviations along the principal directions; in the paper's recipe the code itself"""
    texture: Float[Tensor, "hypotheses texture_rank"]


class Objective(NamedTuple):
    """What makes a hypothesis good."""

    prior: float
    """of a squared standard deviation of a code (in the paper: of its squared norm), against a squared error"""
    paper: bool = False
    """Eq. 5 as it stands, on the codes as they are and all pixels alike, by AdamW: nothing about silhouettes or
    usual distances, nothing about the cloud of the trained codes."""

    def spaces(self, model: Model) -> tuple[CodeSpace, CodeSpace]:
        """In which shape and texture are searched for."""
        book = model.codes
        if self.paper:
            return CodeSpace.raw(book.shapes.shape[-1]), CodeSpace.raw(book.textures.shape[-1])
        return book.shape_space, book.texture_space


class Judged(NamedTuple):
    """How well hypotheses explain some pixels."""

    objective: Float[Tensor, "hypotheses"]
    squared: Float[Tensor, "hypotheses"]
    """the mean squared error per channel over whole pictures, as estimated from these pixels"""


@dataclass(frozen=True, eq=False)
class Pool:
    """Hypotheses on their way, with Adam's memory of each."""

    numbers: Numbers
    first: Numbers
    second: Numbers
    age: Int[Tensor, "hypotheses"]
    cost: Float[Tensor, "hypotheses"]
    """the objective, smoothed over the last steps; infinite where a hypothesis diverged"""
    squared: Float[Tensor, "hypotheses"]
    start: Int[Tensor, "hypotheses"]

    @classmethod
    def of(cls, numbers: Numbers) -> "Pool":
        """Fresh hypotheses, named by their order."""
        nothing = Numbers(*(torch.zeros_like(part) for part in numbers))
        count = len(numbers.angles)
        zeros = torch.zeros(count)
        return cls(numbers, nothing, nothing, zeros.long(), zeros, zeros, torch.arange(count))

    def __len__(self) -> int:
        return len(self.cost)

    def __getitem__(self, index: Int[Tensor, "some"]) -> "Pool":
        numbers, first, second = (
            Numbers(*(part[index] for part in whole)) for whole in (self.numbers, self.first, self.second)
        )
        rest = self.age[index], self.cost[index], self.squared[index], self.start[index]
        return Pool(numbers, first, second, *rest)

    @property
    def leader(self) -> int:
        """The hypothesis of least cost. Raises ``ValueError`` where all have diverged."""
        best = int(self.cost.argmin())
        if not math.isfinite(float(self.cost[best])):
            raise ValueError("the fit diverged from every start")
        return best


def judged(
    model: Model, numbers: Numbers, drawn: Drawn, samples: int, by: Objective, jitter: Tensor | None = None
) -> Judged:
    """Eq. 5's objective of every hypothesis over the drawn pixels, with a silhouette term; differentiable.

    Args:
        jitter: (views, rays) in [-0.5, 0.5], by how many intervals the samples of a ray are moved along it.
    """
    device = model.device
    distance = model.distance * numbers.distance.exp()
    places = (drawn.places - numbers.shift[:, :, None]).to(device)
    angles = numbers.angles.to(device)[..., None, :]
    rays = cast(
        places, angles[..., 0], angles[..., 1], distance.to(device)[..., None], 1.0, (0, 0), model.extent_tensor
    )
    rays = _spans(model, rays, samples, jitter)
    shapes, textures = by.spaces(model)
    shape = model.field.shape_bias(shapes.code(numbers.shape.to(device)))
    texture = model.field.texture_bias(textures.code(numbers.texture.to(device)))
    with autocast(device):
        colour, opacity = render_seen(model, rays, samples, _kept(samples), shape, texture)
    error = (colour.cpu() - drawn.colours).square().mean(-1)
    squared = (error * drawn.shares).sum((1, 2)) / error.shape[1]
    unlikely = numbers.shape.square().sum(-1) + numbers.texture.square().sum(-1)
    if by.paper:
        return Judged(squared + by.prior * unlikely, squared.detach())
    objective = error.mean((1, 2))
    if not model.painted_ground:
        wrong = (opacity.cpu() - drawn.opaque).square() * drawn.sure
        objective = objective + _SILHOUETTE * wrong.mean((1, 2))
    strayed = (numbers.distance / _DISTANCE_SPREAD).square().log1p().mean(-1)
    return Judged(objective + by.prior * unlikely + _DISTANCE_PRIOR * strayed, squared.detach())


def _kept(samples: int) -> int:
    return max(2, samples // 6)


def _spans(model: Model, rays: Rays, samples: int, jitter: Tensor | None) -> Rays:
    """Where rays are sampled: the box, or where the network paints the ground, as its pictures were made."""
    near, far = rays.near, rays.far
    if model.painted_ground:
        near = (rays.origins.detach().norm(dim=-1) - 0.5).expand_as(near)
        far = near + 1.0
    if jitter is not None:
        move = jitter.to(near.device) * (far - near) / samples
        near, far = near + move, far + move
    return replace(rays, near=near, far=far)


class Rates(NamedTuple):
    """How far Adam moves each kind of number in a step."""

    angles: Float[Tensor, "#views 1"]
    distance: Float[Tensor, "#views"]
    shift: Float[Tensor, "#views 1"]
    shape: Float[Tensor, "shape_rank"]
    texture: Float[Tensor, "texture_rank"]


def advanced(model: Model, pool: Pool, drawn: Drawn, samples: int, by: Objective, rates: Rates, jitter: Tensor) -> Pool:
    """One step of Adam for every hypothesis; one whose numbers are no longer finite gets infinite cost."""
    numbers = Numbers(*(part.detach().requires_grad_() for part in pool.numbers))
    found = judged(model, numbers, drawn, samples, by, jitter)
    slopes = Numbers(*torch.autograd.grad(found.objective.sum(), numbers))
    finite = found.objective.detach().isfinite()
    for slope in slopes:
        finite = finite & slope.flatten(1).isfinite().all(1)
    age = pool.age + 1
    whole = zip(pool.numbers, pool.first, pool.second, slopes, rates, strict=True)
    decays = _ADAMW if by.paper else _ADAM
    moved = [_adam(*parts, age, finite, decays) for parts in whole]
    values, first, second = (Numbers(*parts) for parts in zip(*moved, strict=True))
    values = values._replace(
        angles=torch.stack((values.angles[..., 0], values.angles[..., 1].clamp(-_STEEPEST, _STEEPEST)), -1),
        distance=values.distance.clamp(-1.0, 1.5),
    )
    now = found.objective.detach()
    cost = torch.where(pool.age == 0, now, torch.lerp(pool.cost, now, 0.3))
    cost = torch.where(finite, cost, torch.full_like(cost, math.inf))
    return Pool(values, first, second, age, cost, found.squared, pool.start)


def _adam(
    value: Tensor,
    first: Tensor,
    second: Tensor,
    slope: Tensor,
    rate: Tensor,
    age: Tensor,
    finite: Tensor,
    decays: tuple[float, float, float],
) -> tuple[Tensor, Tensor, Tensor]:
    ones = (-1,) + (1,) * (value.ndim - 1)
    slope = torch.where(finite.view(ones), slope, torch.zeros_like(slope))
    first, second = torch.lerp(slope, first, decays[0]), torch.lerp(slope.square(), second, decays[1])
    mean = first / (1 - decays[0] ** age).view(ones)
    scale = (second / (1 - decays[1] ** age).view(ones)).sqrt()
    return value - rate * (mean / (scale + 1e-12) + decays[2] * value), first, second


def cameras(model: Model, numbers: Numbers, index: int, given: Sequence[Camera]) -> tuple[Camera, ...]:
    """A hypothesis' camera for every picture, with focal length and size as given."""
    found = []
    for view, camera in enumerate(given):
        azimuth, elevation = (float(angle) for angle in numbers.angles[index, view])
        distance = model.distance * math.exp(float(numbers.distance[index, view]))
        azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
        found.append(replace(camera, azimuth=azimuth, elevation=elevation, distance=distance))
    return tuple(found)


def codes(model: Model, numbers: Numbers, index: int, by: Objective) -> Codes:
    """A hypothesis' codes."""
    shapes, textures = by.spaces(model)
    return Codes(shapes.code(numbers.shape[index]).clone(), textures.code(numbers.texture[index]).clone())


def twins(pool: Pool, index: int, views: Bool[Tensor, "views"]) -> Bool[Tensor, "hypotheses"]:
    """Which hypotheses see some unknown picture from roughly behind where this one does (azimuth + 180 degrees)."""
    turn = pool.numbers.angles[:, views, 0] - pool.numbers.angles[index, views, 0]
    return (turn.cos() < -0.6).any(-1)


def spread_out(pool: Pool, views: Bool[Tensor, "views"]) -> Int[Tensor, "some"]:
    """Hypotheses in order of cost, the best of each basin before all that stand close to a better one.

    Those that have diverged are left out.
    """
    close = _close(pool, pool, views)
    order = pool.cost.argsort()
    order = order[pool.cost[order].isfinite()]
    first, beside = list[int](), list[int]()
    for index in order.tolist():
        (beside if first and bool(close[index, first].any()) else first).append(index)
    return torch.tensor(first + beside)


def _close(first: Pool, second: Pool, views: Bool[Tensor, "views"]) -> Bool[Tensor, "firsts seconds"]:
    """Which hypotheses are in one basin in all unknown pictures."""
    one, other = (rotation(*pool.numbers.angles[:, views].unbind(-1)) for pool in (first, second))
    cosines = (torch.einsum("avij,bvij->abv", one, other) - 1) / 2
    return (cosines > math.cos(_BASIN)).all(-1)


def rival_of(pool: Pool, among: Pool, views: Bool[Tensor, "views"]) -> Pool:
    """The best of ``among`` that is in another basin than the leader of ``pool``; the leader's twin if none is."""
    apart = ~_close(pool, among, views)[pool.leader] & among.cost.isfinite()
    if not bool(apart.any()):
        return twin_of(pool, pool.leader, views)
    return among[among.cost.where(apart, torch.tensor(math.inf)).argmin()[None]]


def twin_of(pool: Pool, index: int, views: Bool[Tensor, "views"]) -> Pool:
    """The same hypothesis from behind, without memory, in every unknown picture."""
    one = pool[torch.tensor([index])]
    angles = one.numbers.angles.clone()
    angles[:, views, 0] += math.pi
    fresh = Pool.of(one.numbers._replace(angles=angles))
    return replace(fresh, start=one.start, cost=one.cost)


def joined(first: Pool, second: Pool) -> Pool:
    """Both pools' hypotheses."""
    numbers, memory, scale = (
        Numbers(*(torch.cat(parts) for parts in zip(*pair, strict=True)))
        for pair in ((first.numbers, second.numbers), (first.first, second.first), (first.second, second.second))
    )
    age, cost, squared, start = (
        torch.cat((getattr(first, name), getattr(second, name))) for name in ("age", "cost", "squared", "start")
    )
    return Pool(numbers, memory, scale, age, cost, squared, start)
