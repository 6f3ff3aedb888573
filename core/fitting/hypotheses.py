"""Hypotheses of what pictures show: a camera for each and one pair of codes, many of them in one batch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.fitting.observations import Drawn
from core.geometry.camera import Camera, camera_rotation
from core.geometry.rays import Rays, cast_rays
from core.models.codes import CodeSpace
from core.models.model import Model
from core.models.precision import autocast
from core.rendering.importance import render_top_samples

SILHOUETTE = 0.1
"""The squared error of opacity against that of colour."""
STRAY_SPREADS = (0.2, 0.02, 0.3)
"""How far a camera strays before it costs much: rad below the ground's level, the logarithm of the distance away from
that of the training pictures, which all have one, and that of the focal length."""
FRAMED_SPREAD = 0.05
"""Of the distance, of a picture that was moved or scaled before it was fitted."""
CUT_OFF_SPREAD = 0.3
"""The same where an edge cuts the object off, so that its size in the picture was not known."""
STRAY_PRIORS = (2e-3, 2e-3, 2e-4)
"""Against the squared error of a pixel; grows with the logarithm only, so that a picture can insist."""
_BASIN = math.radians(25)
"""Cameras that differ by less mostly end at the same place."""
_LENSES = 0.2
"""So do the same with focal lengths whose logarithms differ by less."""
_STEEPEST = math.radians(89.9)


class DivergedError(ValueError):
    """No hypothesis is finite any more."""

    def __init__(self) -> None:
        super().__init__("the fit diverged from every start")


class Numbers(NamedTuple):
    """All that is searched for.

    Azimuth and elevation are regular at the pole as they stand: an upright camera that looks at the origin turns by
    the same angle for the same step of either everywhere, and above the pole its azimuth is the roll of the picture.
    (It is the direction on the sphere that is not: there, every direction has pictures of any roll beside it.)
    """

    angles: Float[Tensor, "hypotheses views 2"]
    """azimuth, elevation; rad"""
    distance: Float[Tensor, "hypotheses views"]
    """logarithm of the distance over the model's, as far as the lens does not make up for it"""
    zoom: Float[Tensor, "hypotheses views"]
    """logarithm of the focal length over the given one. The camera is as much further away, so that the object keeps
    its size and only the perspective changes."""
    shift: Float[Tensor, "hypotheses views 2"]
    """of the optical axis in the picture, x right and y down, in focal lengths as given; 0 unless a picture was
    reframed"""
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
    spreads: Float[Tensor, "#views 3"] = torch.tensor([STRAY_SPREADS])
    """of :func:`strays`; infinite where a camera is given"""
    forgiving: float = math.inf
    """A colour that is so far off (root mean square over the channels) pulls half as hard as Eq. 5 has it: there is
    something that the model cannot draw."""

    def spaces(self, model: Model) -> tuple[CodeSpace, CodeSpace]:
        """In which shape and texture are searched for."""
        book = model.codes
        if self.paper:
            return CodeSpace.identity(book.shapes.shape[-1]), CodeSpace.identity(book.textures.shape[-1])
        return book.shape_space, book.texture_space


class Judged(NamedTuple):
    """How well hypotheses explain some pixels."""

    objective: Float[Tensor, "hypotheses"]
    squared: Float[Tensor, "hypotheses"]
    """the mean squared error per channel over whole pictures, as estimated from these pixels"""


@dataclass(frozen=True, eq=False)
class Pool:
    """Hypotheses on their way."""

    numbers: Numbers
    cost: Float[Tensor, "hypotheses"]
    """what they are ranked by: during a race the running mean of the objective over its last steps, with what a glance
    thinks of their cameras; infinite where a hypothesis diverged"""
    squared: Float[Tensor, "hypotheses"]
    """as in :class:`Judged`"""
    start: Int[Tensor, "hypotheses"]
    opened: tuple[int, int] = (0, 0)
    """how many principal directions of shape and texture were free to move so far"""

    @classmethod
    def of(cls, numbers: Numbers) -> "Pool":
        """Fresh hypotheses, named by their order."""
        zeros = torch.zeros(len(numbers.angles))
        return cls(numbers, zeros, zeros, torch.arange(len(zeros)))

    def __len__(self) -> int:
        return len(self.cost)

    def __getitem__(self, index: Int[Tensor, "some"]) -> "Pool":
        numbers = Numbers(*(part[index] for part in self.numbers))
        return Pool(numbers, self.cost[index], self.squared[index], self.start[index], self.opened)

    @property
    def leader(self) -> int:
        """The hypothesis of least cost. Raises :class:`DivergedError` where all have diverged."""
        best = int(self.cost.argmin())
        if not math.isfinite(float(self.cost[best])):
            raise DivergedError
        return best


def judged(
    model: Model, numbers: Numbers, drawn: Drawn, samples: int, by: Objective, jitter: Tensor | None = None
) -> Judged:
    """Eq. 5's objective of every hypothesis over the drawn pixels, forgiving as told, with a silhouette term;
    differentiable.

    Args:
        jitter: (views, rays) in [-0.5, 0.5], by how many intervals the samples of a ray are moved along it.
    """
    rays = aimed(model, numbers, drawn, samples, jitter)
    shapes, textures = by.spaces(model)
    shape = model.field.shape_bias(shapes.code(numbers.shape))
    texture = model.field.texture_bias(textures.code(numbers.texture))
    with autocast(model.device):
        colour, opacity = render_top_samples(model, rays, samples, _kept(samples), shape, texture)
    error = (colour.cpu() - drawn.colours).square().mean(-1)
    squared = (error * drawn.shares).sum((1, 2)) / error.shape[1]
    unlikely = numbers.shape.square().sum(-1) + numbers.texture.square().sum(-1)
    if by.paper:
        return Judged(squared + by.prior * unlikely, squared.detach())
    objective = forgiven(error, by).mean((1, 2))
    if not model.white_from_network:
        wrong = (opacity.cpu() - drawn.opaque).square() * drawn.sure
        objective = objective + SILHOUETTE * wrong.mean((1, 2))
    return Judged(objective + by.prior * unlikely + astray(numbers, by), squared.detach())


def forgiven(squared: Tensor, by: Objective) -> Tensor:
    """What squared errors of colours cost: beyond what is forgiven, their logarithm (Cauchy's loss)."""
    if math.isinf(by.forgiving):
        return squared
    return by.forgiving**2 * (squared / by.forgiving**2).log1p()


def strays(numbers: Numbers) -> Float[Tensor, "hypotheses views 3"]:
    """How far cameras stand below the ground's level (rad, at most 0), away from the usual distance, and from the
    usual lens (logarithms).
    """
    return torch.stack((numbers.angles[..., 1].clamp_max(0), numbers.distance, numbers.zoom), -1)


def astray(numbers: Numbers, by: Objective) -> Float[Tensor, "hypotheses"]:
    """What that costs, on average over the pictures."""
    costs = (strays(numbers) / by.spreads).square().log1p() * torch.tensor(STRAY_PRIORS)
    return costs.sum(-1).mean(-1)


def _kept(samples: int) -> int:
    return max(2, samples // 6)


def aimed(model: Model, numbers: Numbers, drawn: Drawn, samples: int = 1, jitter: Tensor | None = None) -> Rays:
    """The rays of the drawn pixels, (hypotheses, views, rays), on the model's device.

    They are clipped to the box, or where the network paints the ground, as its pictures were made.
    """
    device = model.device
    distance = (model.distance * (numbers.distance + numbers.zoom).exp()).to(device)[..., None]
    places = ((drawn.places - numbers.shift[:, :, None]) / numbers.zoom.exp()[..., None, None]).to(device)
    angles = numbers.angles.to(device)[..., None, :]
    rays = cast_rays(places, angles[..., 0], angles[..., 1], distance, 1.0, (0, 0), model.extent_tensor)
    near, far = rays.near, rays.far
    if model.white_from_network:
        near = (rays.origins.detach().norm(dim=-1) - 0.5).expand_as(near)
        far = near + 1.0
    if jitter is not None:
        move = jitter.to(near.device) * (far - near) / samples
        near, far = near + move, far + move
    return replace(rays, near=near, far=far)


def within_bounds(numbers: Numbers, views: Bool[Tensor, "views"]) -> Numbers:
    """With elevations, distances and lenses of these views kept to what is searched."""
    azimuth, elevation = numbers.angles.unbind(-1)
    return numbers._replace(
        angles=torch.stack((azimuth, elevation.clamp(-_STEEPEST, _STEEPEST).where(views, elevation)), -1),
        distance=numbers.distance.clamp(-1.0, 1.5).where(views, numbers.distance),
        zoom=numbers.zoom.clamp(-0.5, 1.5).where(views, numbers.zoom),
    )


def cameras(model: Model, numbers: Numbers, index: int, given: Sequence[Camera]) -> tuple[Camera, ...]:
    """A hypothesis' camera for every picture, of its size."""
    found = []
    for view, camera in enumerate(given):
        azimuth, elevation = (float(angle) for angle in numbers.angles[index, view])
        away, zoom = float(numbers.distance[index, view]), float(numbers.zoom[index, view])
        distance, focal = model.distance * math.exp(away + zoom), camera.focal * math.exp(zoom)
        azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
        found.append(replace(camera, azimuth=azimuth, elevation=elevation, distance=distance, focal=focal))
    return tuple(found)


def twins(pool: Pool, index: int, views: Bool[Tensor, "views"]) -> Bool[Tensor, "hypotheses"]:
    """Which hypotheses see some unknown picture from roughly behind where this one does (azimuth + 180 degrees)."""
    turn = pool.numbers.angles[:, views, 0] - pool.numbers.angles[index, views, 0]
    return (turn.cos() < -0.6).any(-1)


def spread_out(pool: Pool, views: Bool[Tensor, "views"]) -> Int[Tensor, "some"]:
    """Hypotheses in order of cost, the best of each basin and lens before all that stand close to a better one.

    Those that have diverged are left out. Raises :class:`DivergedError` where all have.
    """
    zooms = pool.numbers.zoom[:, views]
    close = _close(pool, pool, views) & ((zooms[:, None] - zooms).abs() < _LENSES).all(-1)
    order = pool.cost.argsort(stable=True)
    order = order[pool.cost[order].isfinite()]
    if not len(order):
        raise DivergedError
    first, beside = list[int](), list[int]()
    for index in order.tolist():
        (beside if first and bool(close[index, first].any()) else first).append(index)
    return torch.tensor(first + beside)


def _close(first: Pool, second: Pool, views: Bool[Tensor, "views"]) -> Bool[Tensor, "firsts seconds"]:
    """Which hypotheses are in one basin in all unknown pictures."""
    one, other = (camera_rotation(*pool.numbers.angles[:, views].unbind(-1)) for pool in (first, second))
    cosines = (torch.einsum("avij,bvij->abv", one, other) - 1) / 2
    return (cosines > math.cos(_BASIN)).all(-1)


def rival_of(pool: Pool, among: Pool, views: Bool[Tensor, "views"]) -> Pool:
    """The best of ``among`` that is in another basin than the leader of ``pool``; if none is, the leader's twin, of
    which nothing is known.
    """
    apart = ~_close(pool, among, views)[pool.leader] & among.cost.isfinite()
    if not bool(apart.any()):
        unknown = twin_of(pool, pool.leader, views)
        return replace(unknown, cost=torch.full_like(unknown.cost, math.inf))
    return among[among.cost.where(apart, torch.tensor(math.inf)).argmin()[None]]


def twin_of(pool: Pool, index: int, views: Bool[Tensor, "views"]) -> Pool:
    """The same hypothesis from behind in every unknown picture."""
    one = pool[torch.tensor([index])]
    angles = one.numbers.angles.clone()
    angles[:, views, 0] += math.pi
    return replace(one, numbers=one.numbers._replace(angles=angles))


def joined(*pools: Pool) -> Pool:
    """All hypotheses of some pools."""
    numbers = Numbers(*(torch.cat(parts) for parts in zip(*(pool.numbers for pool in pools), strict=True)))
    cost, squared, start = (torch.cat([getattr(pool, name) for pool in pools]) for name in ("cost", "squared", "start"))
    return Pool(numbers, cost, squared, start, most_opened(pools))


def most_opened(pools: Sequence[Pool]) -> tuple[int, int]:
    """The directions of shape and of texture that were free to move in any of the pools."""
    shape, texture = zip(*(pool.opened for pool in pools), strict=True)
    return max(shape), max(texture)
