"""The view bank: small views of a model's prototype objects from all round, to rank cameras for a photo by.

Prototypes are clouds of surface points, splatted onto small images. Every view is normalised to its own bounding box,
so a match says from where an object is seen whatever its size in the photo; the ratio of the two sizes then says from
how far.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Float16
from torch import Tensor
from torch.nn import functional

from core.caches import CACHE, Kind
from core.geometry.camera import camera_rotation
from core.models.codes import Codes
from core.models.layers import pad_rows
from core.models.model import Model
from core.models.precision import autocast
from core.models.viewpoint import directions

PROTOTYPES = 120
"""With 60 of them, fits of a model's own objects end in worse codes; with 240, fits of others are no better."""
SIDE = 24
"""px, of a view"""
_CELLS = 40
"""along the longest side of the model's box"""
_MIN_THICKNESS = 0.05
"""of a block's optical depth over a cell: more may be the fringe of something"""
_MIN_POINTS = 20
"""of a prototype that is worth keeping"""
_SPLATTED = 24
"""views at a time: the points of more leave the cache, and take much memory"""


@dataclass(frozen=True, eq=False)
class ViewBank:
    """Small views of prototypes, each normalised to its bounding box."""

    codes: Codes
    """of the prototypes, (prototypes, latent); the first is the mean object"""
    azimuth: Float[Tensor, "views"]
    elevation: Float[Tensor, "views"]
    """rad"""
    masks: Bool[Tensor, "prototypes views side side"]
    luminance: Float16[Tensor, "prototypes views side side"]
    """luminance less its mean over the object, of unit norm; 0 off the object"""
    sizes: Float[Tensor, "prototypes views"]
    """the longer side of the bounding box, in focal lengths"""
    offsets: Float[Tensor, "prototypes views 2"]
    """the middle of the bounding box (x, y) less that of the image, in focal lengths"""
    distance: float
    """scene units, from which all views are seen"""

    @property
    def size(self) -> int:
        """bytes"""
        return self.masks.nbytes + self.luminance.nbytes


class EmptyBankError(ValueError):
    """A model renders nothing that a view bank could hold."""


_in_progress: dict[str, Generator[None, None, ViewBank]] = {}
"""Begun and not finished: the next caller continues from there."""


def view_bank(model: Model) -> ViewBank:
    """The model's view bank, built once (seconds) and kept in memory as far as there is room.

    Raises :class:`EmptyBankError` where the model shows no objects.
    """
    stream = build_view_bank(model)
    while True:
        try:
            next(stream)
        except StopIteration as made:
            return made.value


def build_view_bank(model: Model) -> Generator[None, None, ViewBank]:
    """Build the model's view bank, where it is not there yet, a prototype at a time, so that nobody waits for it later.

    Two callers in turn share the work.
    """
    key = model.fingerprint
    while (bank := CACHE.get(Kind.BANK, key)) is None:
        building = _in_progress.pop(key, None) or _build(model)
        try:
            next(building)
        except StopIteration as made:
            CACHE.put(Kind.BANK, key, made.value, made.value.size)
            return made.value
        else:
            _in_progress[key] = building
            yield None
    return bank


class SizeRange(NamedTuple):
    """How large objects are in training images, as shares of the image: the longer side of the bounding box."""

    median: float
    """seen from somewhat above"""
    min: float
    max: float


def apparent_size(model: Model) -> SizeRange:
    """How large the model's objects are in images of the training kind."""
    bank = view_bank(model)
    scale = model.focal / model.image_size
    from_above = (bank.elevation > 0) & (bank.elevation < math.radians(50))
    median = float(bank.sizes[:, from_above].median())
    return SizeRange(scale * median, scale * float(bank.sizes.min()), scale * float(bank.sizes.max()))


def surface_points(model: Model, codes: Codes) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Points on an object's surface, on a grid in the model's box, and their colours seen from outside."""
    extent = model.extent_tensor
    cell = 2 * float(extent.max()) / _CELLS
    # Blocks of two cells a side: where a block and its neighbours are all empty, its cells are not evaluated.
    counts = [math.ceil(float(half) / cell) for half in extent]
    bias = model.field.shape_bias(codes.shape)
    with torch.no_grad(), autocast(model.device):
        blocks = _density(model, _grid(counts, 2 * cell, extent.device), bias) * cell > _MIN_THICKNESS
        near = _dilate(blocks).repeat_interleave(2, 0).repeat_interleave(2, 1).repeat_interleave(2, 2)
        grid = _grid([2 * count for count in counts], cell, extent.device)
        inside = torch.zeros_like(near)
        inside[near] = _density(model, grid[near], bias) * cell > 0.5
        points = grid[inside & _dilate(~inside)]
        padded = pad_rows(points)
        features = model.field.density(padded, bias)[1]
        inward = model.field.direction_bias(-functional.normalize(padded, dim=-1))
        colours = model.field.colour(features, inward, model.field.texture_bias(codes.texture))
    return points, colours[: len(points)].clamp(0, 1)


def _grid(counts: Sequence[int], step: float, device: torch.device) -> Float[Tensor, "x y z 3"]:
    """Centres of cells around the origin."""
    axes = [(torch.arange(count, device=device) + 0.5 - count / 2) * step for count in counts]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)


def _density(model: Model, points: Float[Tensor, "*batch 3"], bias: Tensor) -> Float[Tensor, "*batch"]:
    parts = points.reshape(-1, 3).split(8192)
    found = [model.field.density(pad_rows(part), bias)[0][: len(part)] for part in parts]
    return torch.cat(found).reshape(points.shape[:-1])


def _dilate(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """With all cells beside them."""
    return functional.max_pool3d(cells.float()[None], 3, 1, 1)[0] > 0.5


def _build(model: Model) -> Generator[None, None, ViewBank]:
    yield from model.find_occupied_cells()
    azimuth, elevation = directions()
    prototypes, kept = _prototypes(model), list[Codes]()
    # In its place from the start: small results among large temporaries keep the memory of these from being returned.
    shape = len(prototypes), len(azimuth)
    masks = torch.empty(*shape, SIDE, SIDE, dtype=torch.bool)
    luminance = torch.empty(*shape, SIDE, SIDE, dtype=torch.half)
    sizes, offsets = torch.empty(shape), torch.empty(*shape, 2)
    for codes in prototypes:
        points, colours = (part.cpu() for part in surface_points(model, codes))
        if len(points) >= _MIN_POINTS:
            for start in range(0, len(azimuth), _SPLATTED):
                some = slice(start, start + _SPLATTED)
                splatted = _splat(points, colours, azimuth[some], elevation[some], model.distance)
                for part, whole in zip(splatted, (masks, luminance, sizes, offsets), strict=True):
                    whole[len(kept), some] = part
            kept.append(codes)
        yield None
    if not kept:
        raise EmptyBankError("the model shows no objects: all of its prototypes are empty")
    codes = Codes(torch.stack([one.shape for one in kept]), torch.stack([one.texture for one in kept]))
    masks, luminance, sizes, offsets = (part[: len(kept)] for part in (masks, luminance, sizes, offsets))
    return ViewBank(codes, azimuth, elevation, masks, luminance, sizes, offsets, model.distance)


def _prototypes(model: Model) -> list[Codes]:
    """The mean object, and objects from all over the shapes: the ones nearest to the centres of k-means."""
    book = model.codes
    valid = book.valid
    coordinates = book.shape_space.coordinates(book.shapes[[book.objects[index].shape for index in valid]])
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
    return [book.mean] + [book[valid[index]] for index in medoids.tolist()]


def _splat(
    points: Float[Tensor, "points 3"],
    colours: Float[Tensor, "points 3"],
    azimuth: Float[Tensor, "views"],
    elevation: Float[Tensor, "views"],
    distance: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """A cloud of points seen from every view: masks, luminance, sizes and offsets as :class:`ViewBank` holds them."""
    x, y, z = (camera_rotation(azimuth, elevation) @ points.T).unbind(1)  # (views, points) each
    depth = (distance - z).clamp_min(1e-3)
    projected = torch.stack((x, -y), 1) / depth[:, None]
    low, high = projected.amin(2), projected.amax(2)
    size, middle = (high - low).amax(-1), (high + low) / 2
    scaled = (projected - middle[..., None]) / size[:, None, None] * (SIDE - 2) + SIDE / 2
    column, row = scaled.long().clamp_(0, SIDE - 1).unbind(1)
    count = len(points)
    # The nearest point of a pixel, found as the least of (depth, index) packed into one number.
    packed = (depth / (4 * distance) * 2**20).long() * count + torch.arange(count)
    nothing = torch.iinfo(torch.long).max
    nearest = torch.full((len(azimuth), SIDE * SIDE), nothing).scatter_reduce(1, row * SIDE + column, packed, "amin")
    masks = (nearest < nothing).float().reshape(-1, SIDE, SIDE)
    luminance = colours.mean(-1)[nearest % count].reshape(masks.shape)
    return masks, normalised_luminance(luminance, masks), size, middle


def normalised_luminance(
    luminance: Float[Tensor, "*batch side side"], mask: Float[Tensor, "*batch side side"]
) -> Tensor:
    """Luminance less its mean over the mask, of unit norm, 0 elsewhere."""
    area = mask.sum((-2, -1), keepdim=True).clamp_min(1e-6)
    mean = (luminance * mask).sum((-2, -1), keepdim=True) / area
    centred = (luminance - mean) * mask
    return centred / centred.square().sum((-2, -1), keepdim=True).sqrt().clamp_min(1e-3)
