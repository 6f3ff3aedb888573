"""Where fitting begins: a bank of small views of prototype objects, ranked against the picture.

The bank holds a few objects of the model, as clouds of surface points thrown onto small pictures from all round.
Every view is normalised to its own bounding box, so a match says from where the object is seen whatever its size in
the picture; the ratio of the two sizes then says from how far.
"""

import math
from collections import OrderedDict
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import camera_rotation, project
from core.models.codes import Codes
from core.models.model import Model
from core.models.precision import autocast
from core.models.viewpoint import AZIMUTHS, directions, glanced

PROTOTYPES = 120
"""With 60 of them, fits of a model's own objects end in worse codes; with 240, fits of others are no better."""
SIDE = 24
"""px, of a view in the bank"""
_CELLS = 40
"""along the longest side of the model's box"""
_SIZE_SHARE, _PLACE_SHARE = 0.3, 1.0
"""of a difference in size (logarithm) and in place (object sizes), against the overlap"""
_ALIKE = 20
"""views of the bank that are asked where an object should lie"""
_GLANCE_SHARE = 0.06
"""of the logarithm of a direction's probability at a glance, against the overlap"""
_HIDDEN = (0.0, 0.25, 0.6)
"""How much of an object may lie beyond an edge that cuts it off, as shares of what is seen of it."""
_HINT = 0.05
"""of a block's optical depth over a cell: more may be the fringe of something"""
_LIGHT_SHARE = 0.1
"""of what lies on the masks, against their overlap: textures are unknown yet, so it settles ties only"""


@dataclass(frozen=True, eq=False)
class Bank:
    """Small views of prototypes, each normalised to its bounding box."""

    codes: Codes
    """of the prototypes, (prototypes, latent); the first is the mean object"""
    azimuth: Float[Tensor, "views"]
    elevation: Float[Tensor, "views"]
    """rad"""
    masks: Float[Tensor, "prototypes views side side"]
    lights: Float[Tensor, "prototypes views side side"]
    """luminance less its mean over the object, of unit norm; 0 off the object"""
    sizes: Float[Tensor, "prototypes views"]
    """the longer side of the bounding box, in focal lengths, from the model's distance"""
    offsets: Float[Tensor, "prototypes views 2"]
    """the middle of the bounding box (x, y) less that of the picture, in focal lengths"""


class EmptyBankError(ValueError):
    """A model shows nothing that a bank could hold."""


class Starts(NamedTuple):
    """Cameras to begin from, best first."""

    azimuth: Float[Tensor, "starts"]
    elevation: Float[Tensor, "starts"]
    distance: Float[Tensor, "starts"]
    shift: Float[Tensor, "starts 2"]
    """from where the object of the bank lies to where the picture's does; focal lengths"""
    prototype: Int[Tensor, "starts"]
    """the object of the bank that looks most like the picture from there"""


_banks: OrderedDict[str, Bank] = OrderedDict()
_underway: dict[str, Generator[None, None, Bank]] = {}
"""Begun and not finished: whoever asks next goes on from there."""


def bank_of(model: Model) -> Bank:
    """The model's bank, made once (seconds) and kept in memory for the last two models."""
    for _ in preparing(model):
        pass
    return _banks[model.fingerprint]


def preparing(model: Model) -> Iterator[None]:
    """Makes the model's bank, where it is not there yet, an object at a time, so that nobody waits for it later.

    Two who prepare in turn share the work.
    """
    key = model.fingerprint
    while key not in _banks:
        making = _underway.pop(key, None) or _making(model)
        try:
            next(making)
        except StopIteration as made:
            _banks[key] = made.value
        else:
            _underway[key] = making
            yield None
    while len(_banks) > 2:
        _banks.popitem(last=False)


def ranked(
    bank: Bank,
    model: Model,
    pixels: Float[Tensor, "height width 3"],
    mask: Bool[Tensor, "height width"],
    focal: float,
    count: int,
    framed: bool = False,
    beyond: Bool[Tensor, "height width"] | None = None,
) -> Starts:
    """The ``count`` most promising cameras for a picture, or as many as there are so far apart, every second one the
    twin of the one before.

    Args:
        pixels: on white, 0..1.
        mask: True on the object; anything on it at all.
        focal: px, of the picture.
        framed: the picture was moved and perhaps scaled: size and place in it are not asked.
        beyond: True where nothing was seen, as an edge cuts the object off.
    """
    looks = _looks(pixels, mask, focal, beyond)
    scores = torch.stack([_scores(bank.masks, bank.lights, look) for look in looks])
    sizes, middles = torch.tensor([look.size for look in looks]), torch.stack([look.middle for look in looks])
    if not framed:
        size = sizes[:, None, None]
        apart = (bank.offsets - middles[:, None, None]).norm(dim=-1)
        scores = scores - _SIZE_SHARE * (bank.sizes / size).log().abs() - _PLACE_SHARE * apart / size
    best, which = scores.flatten(0, 1).max(0)
    if model.viewpoint_classifier:
        best = best + _GLANCE_SHARE * glanced(model.viewpoint_classifier, pixels, mask).log()
    chosen = _spread(bank, best, count)
    look, prototype = which[chosen] // len(bank.masks), which[chosen] % len(bank.masks)
    scale = sizes[look] / bank.sizes[prototype, chosen]
    limited = (model.distance / scale).clamp(0.5 * model.distance, 2 * model.distance)
    shift = middles[look] - bank.offsets[prototype, chosen] * scale[:, None]
    return Starts(bank.azimuth[chosen], bank.elevation[chosen], limited, shift, prototype)


def likenesses(
    bank: Bank,
    pixels: Float[Tensor, "height width 3"],
    mask: Bool[Tensor, "height width"],
    focal: float,
    azimuth: float,
    elevation: float,
    beyond: Bool[Tensor, "height width"] | None = None,
) -> Float[Tensor, "prototypes"]:
    """How much each object of the bank looks like a picture of known camera, from the bank's view nearest to it.

    The arguments are those of :func:`ranked`; angles in rad.
    """
    given = camera_rotation(torch.tensor(azimuth), torch.tensor(elevation))
    nearest = (camera_rotation(bank.azimuth, bank.elevation) * given).sum((-2, -1)).argmax()
    masks, lights = bank.masks[:, nearest], bank.lights[:, nearest]
    return torch.stack([_scores(masks, lights, look) for look in _looks(pixels, mask, focal, beyond)]).amax(0)


def astray(
    bank: Bank, pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"], focal: float
) -> float:
    """How far an object lies, in focal lengths, from where any of those that look most like it would lie.

    Below 0.02 in 476 of 480 pictures of the training kind, and above in all of the same moved by a tenth.
    """
    look = _look(pixels, mask, focal, torch.zeros_like(mask), _box(mask))
    alike = _scores(bank.masks, bank.lights, look).flatten().topk(_ALIKE).indices
    expected = (bank.offsets * (look.size / bank.sizes)[..., None]).flatten(0, 1)[alike]
    return float((expected - look.middle).norm(dim=-1).min())


class Apparent(NamedTuple):
    """How objects stand in training pictures, as shares of the picture."""

    typical: float
    """the longer side of the bounding box, seen from somewhat above"""
    least: float
    most: float


def apparent(model: Model) -> Apparent:
    """How the model's objects stand in pictures of the training kind."""
    bank = bank_of(model)
    scale = model.focal / model.image_size
    from_above = (bank.elevation > 0) & (bank.elevation < math.radians(50))
    typical = float(bank.sizes[:, from_above].median())
    return Apparent(scale * typical, scale * float(bank.sizes.min()), scale * float(bank.sizes.max()))


def surface(model: Model, codes: Codes) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Points on an object's surface, on a grid in the model's box, and their colours seen from outside."""
    extent = model.extent_tensor
    cell = 2 * float(extent.max()) / _CELLS
    # Blocks of two cells a side: where a block and its neighbours are all empty, its cells are not asked.
    counts = [math.ceil(float(half) / cell) for half in extent]
    bias = model.field.shape_bias(codes.shape)
    with torch.no_grad(), autocast(model.device):
        blocks = _density(model, _grid(counts, 2 * cell, extent.device), bias) * cell > _HINT
        near = _spread_out(blocks).repeat_interleave(2, 0).repeat_interleave(2, 1).repeat_interleave(2, 2)
        grid = _grid([2 * count for count in counts], cell, extent.device)
        inside = torch.zeros_like(near)
        inside[near] = _density(model, grid[near], bias) * cell > 0.5
        points = grid[inside & _spread_out(~inside)]
        features = model.field.density(points, bias)[1]
        inward = model.field.direction_bias(-functional.normalize(points, dim=-1))
        colours = model.field.colour(features, inward, model.field.texture_bias(codes.texture))
    return points, colours.clamp(0, 1)


def _grid(counts: Sequence[int], step: float, device: torch.device) -> Float[Tensor, "x y z 3"]:
    """Centres of cells around the origin."""
    axes = [(torch.arange(count, device=device) + 0.5 - count / 2) * step for count in counts]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)


def _density(model: Model, points: Float[Tensor, "*batch 3"], bias: Tensor) -> Float[Tensor, "*batch"]:
    parts = points.reshape(-1, 3).split(8192)
    return torch.cat([model.field.density(part, bias)[0] for part in parts]).reshape(points.shape[:-1])


def _spread_out(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """With all cells beside them."""
    return functional.max_pool3d(cells.float()[None], 3, 1, 1)[0] > 0.5


def _making(model: Model) -> Generator[None, None, Bank]:
    azimuth, elevation = directions()
    kept, views = [], []
    for codes in _prototypes(model):
        points, colours = (part.cpu() for part in surface(model, codes))
        if len(points) >= 20:
            kept.append(codes)
            views.append(_thrown(points, colours, azimuth, elevation, model.distance))
        yield None
    if not kept:
        raise EmptyBankError("the model shows no objects: all of its prototypes are empty")
    codes = Codes(torch.stack([one.shape for one in kept]), torch.stack([one.texture for one in kept]))
    masks, lights, sizes, offsets = (torch.stack(part) for part in zip(*views, strict=True))
    return Bank(codes, azimuth, elevation, masks, lights, sizes, offsets)


def _prototypes(model: Model) -> list[Codes]:
    """The mean object, and objects spread over the shapes: the ones nearest to the centres of k-means."""
    book = model.codes
    sound = book.valid
    coordinates = book.shape_space.coordinates(book.shapes[[book.objects[index].shape for index in sound]])
    coordinates = coordinates * book.shape_space.std
    count = min(PROTOTYPES - 1, len(coordinates))
    generator = torch.Generator(coordinates.device).manual_seed(0)
    centres = coordinates[torch.randperm(len(coordinates), generator=generator)[:count]]
    for _ in range(10):
        nearest = torch.cdist(coordinates, centres).argmin(1)
        centres = torch.stack(
            [coordinates[nearest == i].mean(0) if (nearest == i).any() else centres[i] for i in range(count)]
        )
    medoids = torch.cdist(centres, coordinates).argmin(1).unique()
    return [book.mean] + [book[sound[index]] for index in medoids.tolist()]


def _thrown(
    points: Float[Tensor, "points 3"],
    colours: Float[Tensor, "points 3"],
    azimuth: Float[Tensor, "views"],
    elevation: Float[Tensor, "views"],
    distance: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """A cloud as seen from every view: masks, lights, sizes and offsets as :class:`Bank` holds them."""
    local = points @ camera_rotation(azimuth, elevation).mT - torch.tensor([0.0, 0.0, distance])
    local[..., 2].clamp_max_(-1e-3)
    depth, places = -local[..., 2], project(local, 1.0, (0, 0)).mT  # (views, points), (views, 2, points)
    low, high = places.amin(2), places.amax(2)
    size, middle = (high - low).amax(-1), (high + low) / 2
    scaled = (places - middle[..., None]) / size[:, None, None] * (SIDE - 2) + SIDE / 2
    column, row = scaled.long().clamp_(0, SIDE - 1).unbind(1)
    count = len(points)
    # The nearest point of a pixel, found as the least of (depth, index) packed into one number.
    packed = (depth / (4 * distance) * 2**20).long() * count + torch.arange(count)
    nothing = torch.iinfo(torch.long).max
    nearest = torch.full((len(azimuth), SIDE * SIDE), nothing).scatter_reduce(1, row * SIDE + column, packed, "amin")
    masks = (nearest < nothing).float().reshape(-1, SIDE, SIDE)
    luminance = colours.mean(-1)[nearest % count].reshape(masks.shape)
    return masks, _light(luminance, masks), size, middle


def _light(luminance: Float[Tensor, "*batch side side"], mask: Float[Tensor, "*batch side side"]) -> Tensor:
    """Luminance less its mean over the mask, of unit norm, 0 elsewhere."""
    area = mask.sum((-2, -1), keepdim=True).clamp_min(1e-6)
    mean = (luminance * mask).sum((-2, -1), keepdim=True) / area
    light = (luminance - mean) * mask
    return light / light.square().sum((-2, -1), keepdim=True).sqrt().clamp_min(1e-3)


class _Look(NamedTuple):
    """A picture on the bank's grid, if the whole object fills some box in it."""

    mask: Float[Tensor, "side side"]
    light: Float[Tensor, "side side"]
    seen: Float[Tensor, "side side"]
    """0 where the picture says nothing"""
    size: float
    """the box's longer side, in focal lengths"""
    middle: Float[Tensor, "2"]
    """of the box less that of the picture, (x, y) in focal lengths"""


def _looks(pixels: Tensor, mask: Tensor, focal: float, beyond: Tensor | None) -> list[_Look]:
    """The picture as it is; where an edge cuts the object off, also as it is if more or less lies beyond it."""
    beyond = torch.zeros_like(mask) if beyond is None else beyond
    left, top, right, bottom = _box(mask)
    edges = beyond[:, 0].all(), beyond[0].all(), beyond[:, -1].all(), beyond[-1].all()
    sides = [_HIDDEN if edge else _HIDDEN[:1] for edge in edges]
    across, down = right - left, bottom - top
    boxes = [
        (left - one * across, top - two * down, right + three * across, bottom + four * down)
        for one, two, three, four in product(*sides)
    ]
    return [_look(pixels, mask, focal, beyond, box) for box in boxes]


def _look(pixels: Tensor, mask: Tensor, focal: float, beyond: Tensor, box: tuple[float, ...]) -> _Look:
    left, top, right, bottom = box
    height, width = mask.shape
    size = max(bottom - top, right - left)
    # A grid over the square around the box, widened by the bank's margin of one pixel a side.
    reach = size * SIDE / (SIDE - 2)
    steps = (torch.arange(SIDE * 3) + 0.5) / (SIDE * 3) - 0.5
    y = ((top + bottom) / 2 + steps * reach) / height * 2 - 1
    x = ((left + right) / 2 + steps * reach) / width * 2 - 1
    grid = torch.stack(torch.broadcast_tensors(x[None, :], y[:, None]), -1)[None]
    both = torch.stack((mask.float(), pixels.mean(-1) * mask), 0)[None].float()
    shrunk = functional.avg_pool2d(functional.grid_sample(both, grid, "bilinear", "zeros", False), 3)[0]
    cover, luminance = shrunk[0], shrunk[1] / shrunk[0].clamp_min(1e-3)
    seen = functional.avg_pool2d(
        functional.grid_sample((~beyond)[None, None].float(), grid, "nearest", "border", False), 3
    )
    middle = torch.tensor([left + right - width, top + bottom - height]) / (2 * focal)
    return _Look(cover, _light(luminance, cover), seen[0, 0], size / focal, middle)


def _box(mask: Tensor) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the object in px; right and bottom lie just behind it."""
    rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _scores(
    masks: Float[Tensor, "*views side side"], lights: Float[Tensor, "*views side side"], look: _Look
) -> Float[Tensor, "*views"]:
    """Overlap of the masks (intersection over union) where the picture is seen, and a share of the correlation of what
    lies on them.
    """
    views, flat = masks.flatten(-2), look.mask.flatten()
    shared = views @ flat
    overlap = shared / (views @ look.seen.flatten() + flat.sum() - shared)
    return overlap + _LIGHT_SHARE * (lights.flatten(-2) @ look.light.flatten())


def _spread(bank: Bank, scores: Float[Tensor, "views"], count: int) -> Int[Tensor, "count"]:
    """Views in order of their scores, none beside one taken before it, each followed by its twin (azimuth + 180)."""
    remaining, taken = scores.clone(), list[int]()
    half = AZIMUTHS // 2
    while len(taken) < count and bool(torch.isfinite(remaining).any()):
        view = int(remaining.argmax())
        row, column = divmod(view, AZIMUTHS)
        for azimuth in (column, (column + half) % AZIMUTHS):
            if torch.isfinite(remaining[row * AZIMUTHS + azimuth]):
                taken.append(row * AZIMUTHS + azimuth)
            beside = [row * AZIMUTHS + (azimuth + step) % AZIMUTHS for step in (-1, 0, 1)]
            remaining[beside] = -math.inf
    return torch.tensor(taken[:count])
