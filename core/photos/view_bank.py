"""The view bank: small views of a model's prototypes from all sides, used to rank cameras for a photo.

Prototypes are clouds of surface points, splatted onto small images. Every view is normalised to its bounding box, so a
match gives the direction independent of the size; the ratio of the sizes then gives the distance.
:func:`build_view_bank` builds a bank once per model and user, and keeps it in the cache folder.
"""

import math
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, UInt8
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from core.classifiers.viewpoint import directions
from core.geometry.camera import camera_rotation
from core.models.codes import Codes
from core.models.model import Model
from core.models.occupied_cells import pack
from core.rendering.surface import surface_points
from core.runtime.files import atomic_file
from core.runtime.folders import VIEW_BANKS, cache_folder
from core.runtime.pool import map_pieces

PROTOTYPES = 120
"""With 60, fits of a model's own objects end in worse codes; with 240, fits of other objects are no better."""
SIDE = 24  # px, of a view
FORMAT = "view-bank-2"  # of the files; others are rebuilt
_MIN_POINTS = 20  # points of a usable prototype
_SPLATTED = 24  # views at a time: points of more leave the cache and take much memory
_TENSORS = ("silhouettes", "sizes", "offsets")  # in the files, beside codes and distance


@dataclass(frozen=True, eq=False)
class ViewBank:
    """Small views of prototypes from :func:`core.classifiers.viewpoint.directions`, normalised to their bounding boxes.

    Raises ``ValueError`` for parts that do not match.
    """

    codes: Codes  # of the prototypes, (prototypes, latent); the first is the mean object
    distance: float  # scene units, of all views
    silhouettes: UInt8[Tensor, "prototypes views bytes"]
    """masks, pixels row by row, eight to a byte, the lowest bit first"""
    sizes: Float[Tensor, "prototypes views"]  # longer side of the bounding box, in focal lengths
    offsets: Float[Tensor, "prototypes views 2"]
    """middle of the bounding box (x, y) relative to the image's, in focal lengths"""

    def __post_init__(self) -> None:
        count = len(self.codes.shape), len(self.azimuth)
        shapes = [(*count, SIDE * SIDE // 8), count, (*count, 2)]
        if [getattr(self, name).shape for name in _TENSORS] != shapes:
            raise ValueError(f"the parts of a view bank do not fit {count[0]} prototypes")
        finite = bool(self.sizes.isfinite().all() and self.offsets.isfinite().all())
        if not (finite and 0 < self.distance < math.inf):
            raise ValueError("the numbers of a view bank must be finite")

    @property
    def azimuth(self) -> Float[Tensor, "views"]:
        """rad"""
        return directions()[0]

    @property
    def elevation(self) -> Float[Tensor, "views"]:
        """rad"""
        return directions()[1]

    @property
    def is_empty(self) -> bool:
        """The bank has no prototypes, as the model renders nothing."""
        return not len(self.codes.shape)

    def require_prototypes(self) -> None:
        """Raise ``ValueError`` if the bank is empty."""
        if self.is_empty:
            raise ValueError("the model shows no objects: all of its prototypes are empty")


def build_view_bank(model: Model) -> Generator[float, None, ViewBank]:
    """Read the view bank of a model from the cache folder, or compute it (seconds) and keep it there.

    Yields the finished share (0..1) after each prototype; returns the bank.
    """
    path = cache_folder() / VIEW_BANKS / f"{model.fingerprint}.{FORMAT}.safetensors"
    if (bank := _read(path)) is None:
        bank = yield from _build(model)
        if not bank.is_empty:
            _save(bank, path)
    return bank


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


# Keeping


def _read(path: Path) -> ViewBank | None:
    """Map a file into memory; None if it is missing or damaged."""
    try:
        with safe_open(path, framework="pt") as file:
            codes = Codes(file.get_tensor("shape"), file.get_tensor("texture"))
            distance = float(file.get_tensor("distance"))
            return ViewBank(codes, distance, *(file.get_tensor(name) for name in _TENSORS))
    except (OSError, SafetensorError, ValueError, RuntimeError, TypeError):
        return None


def _save(bank: ViewBank, path: Path) -> None:
    tensors = {name: getattr(bank, name) for name in _TENSORS}
    tensors |= {"shape": bank.codes.shape, "texture": bank.codes.texture, "distance": torch.tensor(bank.distance)}
    with suppress(OSError, ValueError, SafetensorError):  # an unwritable folder
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as partial:
            save_file({name: tensor.cpu().contiguous() for name, tensor in tensors.items()}, partial)


# Building


def _build(model: Model) -> Generator[float, None, ViewBank]:
    for _ in model.find_occupied_cells():
        yield 0.0
    azimuth, elevation = directions()
    prototypes = _prototypes(model)
    # Preallocated: small results between large temporaries would keep the memory of these from being returned.
    shape = len(prototypes), len(azimuth)
    silhouettes = torch.empty(*shape, SIDE * SIDE // 8, dtype=torch.uint8)
    parts = silhouettes, torch.empty(shape), torch.empty(*shape, 2)

    def fill(number: int) -> bool:
        points = surface_points(model, prototypes[number])[0].cpu()
        for start in range(0, len(azimuth) if len(points) >= _MIN_POINTS else 0, _SPLATTED):
            some = slice(start, start + _SPLATTED)
            masks, size, offset = _splat(points, azimuth[some], elevation[some], model.distance)
            for part, whole in zip((pack(masks).reshape(len(masks), -1), size, offset), parts, strict=True):
                whole[number, some] = part
        return len(points) >= _MIN_POINTS

    kept = list[bool]()
    for seen in map_pieces(fill, range(len(prototypes))):
        kept.append(seen)
        yield len(kept) / len(prototypes)
    shapes, textures = (torch.stack([getattr(one, kind) for one in prototypes]) for kind in ("shape", "texture"))
    return ViewBank(Codes(shapes[kept], textures[kept]), model.distance, *(part[kept] for part in parts))


def _prototypes(model: Model) -> list[Codes]:
    """Return the mean object and varied objects, those nearest to the centres of k-means over shapes."""
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
    azimuth: Float[Tensor, "views"],
    elevation: Float[Tensor, "views"],
    distance: float,
) -> tuple[Bool[Tensor, "views side side"], Float[Tensor, "views"], Float[Tensor, "views 2"]]:
    """Return the masks of a point cloud from every view, with their sizes and offsets."""
    x, y, z = (camera_rotation(azimuth, elevation) @ points.T).unbind(1)  # (views, points) each
    depth = (distance - z).clamp_min(1e-3)
    projected = torch.stack((x, -y), 1) / depth[:, None]
    low, high = projected.amin(2), projected.amax(2)
    size, middle = (high - low).amax(-1), (high + low) / 2
    scaled = (projected - middle[..., None]) / size[:, None, None] * (SIDE - 2) + SIDE / 2
    column, row = scaled.long().clamp_(0, SIDE - 1).unbind(1)
    masks = torch.zeros(len(azimuth), SIDE * SIDE, dtype=torch.bool).scatter_(1, row * SIDE + column, True)
    return masks.reshape(-1, SIDE, SIDE), size, middle


def unpack_bits(packed: UInt8[Tensor, "views bytes"]) -> Float[Tensor, "views pixels"]:
    """Unpack the masks (0 or 1) of :attr:`ViewBank.silhouettes`."""
    return ((packed[..., None] >> torch.arange(8, dtype=torch.uint8)) & 1).flatten(-2).float()
