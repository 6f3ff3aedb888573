"""Where hypotheses enter a race: at cameras of the bank, with shapes towards its objects, or where a fit left off.

Codes have local minima, so shapes race as cameras do: every camera of the bank comes with the shape that looks most
like the picture from there, and where all cameras are known, several shapes come with them.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.fitting.hypotheses import Numbers, Pool, cameras, most_opened, spread_out, within_bounds
from core.fitting.schedule import AROUND
from core.geometry.camera import Camera
from core.models.codes import Codes, CodeSpace
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.view_bank import EmptyBankError, Starts, bank_of, likenesses, ranked

_LIKENESS = 0.6
"""How much of the shape of its likeness in the bank a hypothesis begins with, the rest being the mean shape."""
_SAME = 1e-3
"""Standard deviations by which an object of the bank, where it is the mean one, differs from the mean shape at most."""
_ZOOMS = (0.0, -0.3, 0.3)
"""Logarithms of focal lengths over the model's that pairs of starts (a camera and mostly its twin) take turns in, where
these are searched for: a code that has settled with one lens does not let go of it."""
_SIZES = 0.25
"""How much the logarithm of an object's apparent size differs from that of its likeness in the bank."""


def entrants(model: Model, photos: Sequence[Photo], given: Sequence[Camera], count: int, lens: bool) -> Pool:
    """At most ``count`` hypotheses: the best cameras of the bank for every picture without one, each with shapes
    towards what looks most like the pictures from there; and where all cameras are known, that many shapes.

    Args:
        given: known cameras, and for unknown ones their size and focal length.
        lens: unknown cameras begin with several focal lengths.
    """
    unknown = torch.tensor([photo.camera is None for photo in photos])
    space, views = model.codes.shape_space, len(photos)
    found = {
        view: ranked(
            bank_of(model), model, photo.pixels, photo.mask, given[view].focal, count, photo.cropped, photo.unseen
        )
        for view, photo in enumerate(photos)
        if unknown[view]
    }
    count = min([count, *(len(starts.azimuth) for starts in found.values())])
    alike = torch.zeros(count, len(space.std)) if found else _likely_shapes(model, photos, given, count)
    count = len(alike)
    angles, distance, shift = torch.zeros(count, views, 2), torch.zeros(count, views), torch.zeros(count, views, 2)
    zoom = torch.zeros_like(distance)
    if lens:
        zoom[:, unknown] = torch.tensor(_ZOOMS).repeat_interleave(2).repeat(count)[:count, None]
    for view, (photo, camera) in enumerate(zip(photos, given, strict=True)):
        angles[:, view] = torch.tensor([camera.azimuth, camera.elevation])
        distance[:, view] = math.log(camera.distance / model.distance)
        if view in found:
            starts = Starts(*(part[:count] for part in found[view]))
            angles[:, view] = torch.stack((starts.azimuth, starts.elevation), -1)
            away = (starts.distance / model.distance).log()
            # Objects differ in size too: only what that does not explain is put down to the distance.
            distance[:, view] = away - away.clamp(-_SIZES, _SIZES)
            shift[:, view] = starts.shift * photo.cropped
            alike += space.coordinates(bank_of(model).codes.shape)[starts.prototype] / len(found)
    texture = torch.zeros(count, len(model.codes.texture_space.std))
    return Pool.of(Numbers(angles, distance, zoom, shift, _LIKENESS * alike, texture))


def _likely_shapes(
    model: Model, photos: Sequence[Photo], cameras: Sequence[Camera], count: int
) -> Float[Tensor, "count rank"]:
    """The mean shape, and those of the bank, if it has any, that look most like pictures of known cameras."""
    space = model.codes.shape_space
    mean = torch.zeros(1, len(space.std))
    if count == 1:
        return mean
    try:
        bank = bank_of(model)
    except EmptyBankError:  # where the camera is known, even a mist can be fitted
        return mean
    shapes, likely = space.coordinates(bank.codes.shape), torch.zeros(len(bank.codes.shape))
    for photo, camera in zip(photos, cameras, strict=True):
        seen = photo.pixels, photo.mask, camera.focal
        likely += likenesses(bank, *seen, camera.azimuth, camera.elevation, photo.unseen)
    others = (shapes.abs().amax(1) > _SAME).nonzero()[:, 0]
    best = others[likely[others].argsort(descending=True)[: count - 1]]
    return torch.cat((mean, shapes[best]))


def gone_on(
    model: Model,
    photos: Sequence[Photo],
    given: Sequence[Camera],
    found: Sequence[Camera],
    shift: Float[Tensor, "views 2"],
    codes: Codes,
    spaces: tuple[CodeSpace, CodeSpace],
) -> Pool:
    """One hypothesis, where an earlier fit left it; known cameras are those of the pictures.

    Args:
        given: as for :func:`entrants`.
        found, shift, codes: of the earlier fit.
        spaces: in which shape and texture are searched for.
    """
    at = [photo.camera or camera for photo, camera in zip(photos, found, strict=True)]
    angles = torch.tensor([[(camera.azimuth, camera.elevation) for camera in at]])
    zoom = torch.tensor([[math.log(one.focal / two.focal) for one, two in zip(at, given, strict=True)]])
    away = torch.tensor([[math.log(camera.distance / model.distance) for camera in at]]) - zoom
    shape, texture = (space.coordinates(code) for space, code in zip(spaces, (codes.shape, codes.texture), strict=True))
    return Pool.of(Numbers(angles, away, zoom, shift[None], shape[None], texture[None]))


def renewed(model: Model, photos: Sequence[Photo], given: Sequence[Camera], pool: Pool, count: int) -> Pool:
    """At most ``count`` hypotheses at and around the cameras of a pool's best basins
    (:data:`core.fitting.schedule.AROUND`), with codes that know nothing of what those have learnt: the mean ones, and
    shapes towards what looks most like the pictures from there.
    """
    unknown = torch.tensor([photo.camera is None for photo in photos])
    placed = []
    for index, around in zip(spread_out(pool, unknown).tolist(), AROUND, strict=False):
        at = cameras(model, pool.numbers, index, given)
        likely = _LIKENESS * _likely_shapes(model, photos, at, max(most for *_, most in around))
        placed += [(rank, index, move, shape) for *move, most in around for rank, shape in enumerate(likely[:most])]
    placed.sort(key=lambda one: one[0])  # where there are not so many, every place has its likeliest shapes
    _, indices, moves, shapes = zip(*placed[:count], strict=True)
    begin = pool[torch.tensor(indices)]
    angles = begin.numbers.angles + torch.tensor(moves).deg2rad()[:, None] * unknown[:, None]
    texture = torch.zeros_like(begin.numbers.texture)
    numbers = begin.numbers._replace(angles=angles, shape=torch.stack(shapes), texture=texture)
    return replace(begin, numbers=within_bounds(numbers, unknown), opened=(0, 0))


def combined(finalists: Sequence[tuple[list[int], Pool]], views: int, count: int) -> Pool:
    """Hypotheses of all pictures, from those of races for some of them: the ``count`` cheapest combinations.

    Args:
        finalists: which pictures they are of, and what was left of their race.
    """
    combinations: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    for _, pool in finalists:
        costs = enumerate(pool.cost.tolist())
        longer = [(cost + more, (*taken, index)) for index, more in costs for cost, taken in combinations]
        combinations = sorted(longer)[:count]
    pool = Pool.of(_merged(finalists, views, torch.tensor([taken for _, taken in combinations])))
    return replace(pool, opened=most_opened([part for _, part in finalists]))


def _merged(finalists: Sequence[tuple[list[int], Pool]], views: int, taken: Int[Tensor, "some parts"]) -> Numbers:
    """The cameras of the finalists, and the mean of the codes they came with."""
    pairs = list(zip(finalists, taken.unbind(1), strict=True))
    chosen = [Numbers(*(part[index] for part in pool.numbers)) for (_, pool), index in pairs]
    placed = [part.new_zeros(len(taken), views, *part.shape[2:]) for part in chosen[0][:4]]
    for (some, _), numbers in zip(finalists, chosen, strict=True):
        for whole, part in zip(placed, numbers[:4], strict=True):
            whole[:, some] = part
    means = [torch.stack(parts).mean(0) for parts in zip(*(numbers[4:] for numbers in chosen), strict=True)]
    return Numbers(*placed, *means)
