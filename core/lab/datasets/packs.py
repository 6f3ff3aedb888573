"""Datasets in one small file: the views of each object are tiles of one WebP image, with the masks as its opacity.

A safetensors file of three tensors: the WebP images one after the other (``images``), where each ends (``ends``), and
azimuth, elevation (rad) and distance (scene units) of all views (``cameras``, float32). Its metadata names the objects.
"""

import json
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from PIL import Image
from safetensors.torch import save
from torch import Tensor

from core.geometry.camera import Camera
from core.runtime.files import atomic_file
from core.runtime.reading import open_image, parse_json, read_tensors, reading, typed

SUFFIX = ".views"
FORMAT = "codenerf-views-1"
_METHOD = 6  # of WebP: the slowest, a tenth smaller than the usual 4


class PackedObject(NamedTuple):
    """The fields of :class:`core.lab.datasets.srn.ObjectViews`."""

    name: str
    shape_id: str
    texture_id: str
    images: UInt8[np.ndarray, "views height width 3"]
    masks: Bool[np.ndarray, "views height width"]
    cameras: tuple[Camera, ...]


class PackEntry(NamedTuple):
    """An object of a pack, in the pack's order."""

    name: str
    shape_id: str
    texture_id: str
    views: int


class _Header(NamedTuple):
    """Description of a pack in its metadata."""

    category: str
    size: int  # px, width and height of a view
    focal: float  # px
    objects: tuple[PackEntry, ...]


def is_pack(path: Path) -> bool:
    """True for a file of this format, judged by its ending."""
    return path.suffix.lower() == SUFFIX and path.is_file()


def write_pack(path: Path, category: str, objects: Iterable[PackedObject], quality: int) -> Iterator[str]:
    """Write objects with square images of one size and focal length, yielding each name; the file appears at the end.

    The ``quality`` of compressed colours is 1 to 100; 100 is lossless. Masks are kept exactly.
    """
    entries = list[PackEntry]()
    images = list[bytes]()
    cameras = list[Camera]()
    for packed in objects:
        entries.append(PackEntry(*packed[:3], views=len(packed.images)))
        images.append(_encode(packed.images, packed.masks, quality))
        cameras += packed.cameras
        yield packed.name
    listed = [entry._asdict() for entry in entries]
    header = {"category": category, "size": cameras[0].width, "focal": cameras[0].focal, "objects": listed}
    angles = [(camera.azimuth, camera.elevation, camera.distance) for camera in cameras]
    tensors = {
        "images": torch.frombuffer(bytearray(b"".join(images)), dtype=torch.uint8),
        "ends": torch.tensor([len(image) for image in images]).cumsum(0),
        "cameras": torch.tensor(angles, dtype=torch.float32),
    }
    with atomic_file(path, index_pack) as partial:
        partial.write_bytes(save(tensors, {"format": FORMAT, "dataset": json.dumps(header)}))


def index_pack(path: Path) -> tuple[str, tuple[PackEntry, ...]]:
    """Return the category and the objects of a pack. Raises ``ValueError`` naming a file that is not one."""
    header, _ = _open(path, path.stat().st_mtime_ns)
    return header.category, header.objects


def read_packed(path: Path, name: str, scale: float = 1.0) -> PackedObject:
    """Return an object; ``scale``: scene units of a unit of its distances. ``ValueError`` naming a broken file."""
    header, tensors = _open(path, path.stat().st_mtime_ns)
    position, entry = next(numbered for numbered in enumerate(header.objects) if numbered[1].name == name)
    first_view = sum(packed.views for packed in header.objects[:position])
    begin = int(tensors["ends"][position - 1]) if position else 0
    with reading(path, "a pack of views"):
        image = tensors["images"][begin : int(tensors["ends"][position])].numpy().tobytes()
        images, masks = _decode(image, entry.views, header.size)
        cameras = tuple(
            Camera(azimuth, elevation, distance * scale, header.focal, header.size, header.size)
            for azimuth, elevation, distance in tensors["cameras"][first_view : first_view + entry.views].tolist()
        )
    return PackedObject(entry.name, entry.shape_id, entry.texture_id, images, masks, cameras)


@lru_cache(maxsize=8)
def _open(path: Path, _modified: int) -> tuple[_Header, dict[str, Tensor]]:
    """Read a file of a certain time of modification, once for all of its objects; images stay compressed."""
    with reading(path, "a pack of views"):
        metadata, tensors = read_tensors(path)
        if metadata.get("format") != FORMAT or set(tensors) != {"images", "ends", "cameras"}:
            raise ValueError("it is not a pack of views")
        header = typed(_Header, parse_json(metadata["dataset"]), name="dataset")
        views = sum(entry.views for entry in header.objects)
        if len(tensors["ends"]) != len(header.objects) or tensors["cameras"].shape != (views, 3):
            raise ValueError("its tensors do not fit its list of objects")
    return header, tensors


def _grid(views: int) -> tuple[int, int]:
    """Return the numbers of rows and columns of the tiles of an object."""
    columns = math.ceil(math.sqrt(views))
    return math.ceil(views / columns), columns


def _encode(
    images: UInt8[np.ndarray, "views side side 3"], masks: Bool[np.ndarray, "views side side"], quality: int
) -> bytes:
    """Compress the views as tiles; ``exact`` keeps the antialiased colours that the mask leaves out."""
    side = images.shape[1]
    rows, columns = _grid(len(images))
    tiles = np.full((rows * columns, side, side, 4), 255, np.uint8)
    tiles[: len(images), ..., :3] = images
    tiles[: len(images), ..., 3] = 255 * masks
    sheet = tiles.reshape(rows, columns, side, side, 4).swapaxes(1, 2).reshape(rows * side, columns * side, 4)
    file = BytesIO()
    Image.fromarray(sheet).save(file, "webp", quality=quality, lossless=quality == 100, method=_METHOD, exact=True)
    return file.getvalue()


def _decode(
    image: bytes, views: int, side: int
) -> tuple[UInt8[np.ndarray, "views side side 3"], Bool[np.ndarray, "views side side"]]:
    """Invert :func:`_encode`."""
    rows, columns = _grid(views)
    with open_image(BytesIO(image)) as opened:
        sheet = np.asarray(opened.convert("RGBA"))
    if sheet.shape != (rows * side, columns * side, 4):
        raise ValueError(f"an image of {sheet.shape[1]}x{sheet.shape[0]} px does not hold {views} views of {side} px")
    tiles = sheet.reshape(rows, side, columns, side, 4).swapaxes(1, 2).reshape(-1, side, side, 4)[:views]
    return np.ascontiguousarray(tiles[..., :3]), tiles[..., 3] > 127
