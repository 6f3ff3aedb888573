"""Building a model's view bank (:mod:`core.models.view_bank`), which model files hold.

Prototypes are clouds of surface points, splatted onto small images.
"""

import math
from collections.abc import Generator
from typing import NamedTuple
from weakref import WeakKeyDictionary

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.classifiers.viewpoint import directions
from core.geometry.camera import camera_rotation
from core.models.model import Model
from core.models.occupied_cells import pack
from core.models.view_bank import SIDE, ViewBank
from core.rendering.surface import surface_points
from core.runtime.pool import map_pieces
from core.streams import run_to_end

PROTOTYPES = 120
"""With 60, fits of a model's own objects end in worse codes; with 240, fits of other objects are no better."""
_MIN_POINTS = 20  # points of a usable prototype
_SPLATTED = 24  # views per batch; larger batches overflow the processor's cache
_BUILT: WeakKeyDictionary[Model, ViewBank] = WeakKeyDictionary()  # of models whose files have no bank


def build_view_bank(model: Model) -> Generator[float, None, ViewBank]:
    """Return the view bank of a model's file; without one, compute it (seconds) once per process.

    Yields the finished fraction (0..1) after each prototype while computing.
    """
    bank = model.view_bank or _BUILT.get(model)
    if bank is None:
        bank = _BUILT[model] = yield from _build(model)
    return bank


def view_bank(model: Model) -> ViewBank:
    """Return a model's view bank as :func:`build_view_bank` does, without progress."""
    return run_to_end(build_view_bank(model))


class SizeRange(NamedTuple):
    """Sizes of objects in training images, as fractions of the image: the longer side of the bounding box."""

    median: float  # seen from slightly above
    min: float
    max: float


def apparent_size(bank: ViewBank, model: Model) -> SizeRange:
    """Return how large objects are in the model's training images. Raises ``ValueError`` for an empty bank."""
    bank.require_prototypes()
    scale = model.focal / model.image_size
    from_above = (bank.elevation > 0) & (bank.elevation < math.radians(50))
    median = float(bank.sizes[:, from_above].median())
    return SizeRange(scale * median, scale * float(bank.sizes.min()), scale * float(bank.sizes.max()))


def _build(model: Model) -> Generator[float, None, ViewBank]:
    for _ in model.find_occupied_cells():
        yield 0.0
    azimuth, elevation = directions()
    rows = _prototypes(model)
    mean = model.mean
    # Preallocated: small results between large temporaries would keep the memory of these from being returned.
    shape = len(rows), len(azimuth)
    silhouettes = torch.empty(*shape, SIDE * SIDE // 8, dtype=torch.uint8)
    sizes = torch.empty(shape, dtype=torch.half)  # the precision of files
    offsets = torch.empty(*shape, 2, dtype=torch.half)

    def fill(number: int) -> bool:
        row = rows[number]
        prototype = mean if row < 0 else mean.changed(shape=model.codes.shapes[row])
        points = surface_points(prototype)[0].cpu()
        for start in range(0, len(azimuth) if len(points) >= _MIN_POINTS else 0, _SPLATTED):
            views = slice(start, start + _SPLATTED)
            masks, size, offset = _splat(points, azimuth[views], elevation[views], model.distance)
            silhouettes[number, views] = pack(masks).reshape(len(masks), -1)
            sizes[number, views] = size
            offsets[number, views] = offset
        return len(points) >= _MIN_POINTS

    usable = list[bool]()
    for is_usable in map_pieces(fill, range(len(rows))):
        usable.append(is_usable)
        yield len(usable) / len(rows)
    prototypes = torch.tensor(rows)[usable]
    return ViewBank(prototypes, model.distance, silhouettes[usable], sizes[usable].float(), offsets[usable].float())


def _prototypes(model: Model) -> list[int]:
    """Return -1 for the mean shape, then the rows of varied shapes: those nearest to the centres of k-means."""
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
    return [-1] + [book.objects[valid[index]].shape for index in medoids.tolist()]


def _splat(
    points: Float[Tensor, "points 3"],
    azimuth: Float[Tensor, "views"],
    elevation: Float[Tensor, "views"],
    distance: float,
) -> tuple[Bool[Tensor, "views side side"], Float[Tensor, "views"], Float[Tensor, "views 2"]]:
    """Return the masks of a point cloud from every view, with their sizes and offsets."""
    x, y, z = (camera_rotation(azimuth, elevation) @ points.T).unbind(1)  # (views, points) each
    depth = (distance - z).clamp_min(1e-3)
    projected = torch.stack((x, -y), 1) / depth[:, None]
    low, high = projected.aminmax(dim=2)
    size = (high - low).amax(-1)
    middle = (high + low) / 2
    scaled = (projected - middle[..., None]) / size[:, None, None] * (SIDE - 2) + SIDE / 2
    column, row = scaled.long().clamp_(0, SIDE - 1).unbind(1)
    masks = torch.zeros(len(azimuth), SIDE * SIDE, dtype=torch.bool).scatter_(1, row * SIDE + column, True)
    return masks.reshape(-1, SIDE, SIDE), size, middle
