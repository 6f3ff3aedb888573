"""Puts objects before a split's cameras, one after another, and writes the dataset."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from core.datasets.rasteriser import Rasteriser, Surface
from core.datasets.splits import Split, split_cameras
from core.datasets.srn import ObjectViews, write_manifest, write_object


@dataclass(frozen=True)
class Sitter:
    """An object that waits to be pictured."""

    name: str
    shape_id: str
    texture_id: str
    surfaces: Callable[[], Sequence[Surface]]
    """made only when its turn comes"""


def picture_all(
    sitters: Sequence[Sitter], out: Path | str, category: str, split: Split, views: int, size: int
) -> Iterator[str]:
    """Writes the sitters into the dataset ``out``, yielding each one's name once it is there.

    Objects that are there already with as many views of this size are passed over, so a stopped job resumes.
    Raises ``RuntimeError`` where the machine has no OpenGL, ``ValueError`` for an object that cannot be made.
    """
    if views < 1 or size < 1:
        raise ValueError(f"views and size must be positive, got {views} and {size}")
    write_manifest(out, category, {s.name: (s.shape_id, s.texture_id) for s in sitters})
    with Rasteriser(size) as rasteriser:
        for sitter in sitters:
            if not _is_there(Path(out) / sitter.name, views, size):
                rasteriser.upload(sitter.surfaces())
                cameras = split_cameras(split, views, sitter.name, category, size)
                images, masks = zip(*(rasteriser.draw(camera) for camera in cameras), strict=True)
                identity = (sitter.name, sitter.shape_id, sitter.texture_id)
                write_object(out, ObjectViews(*identity, np.stack(images), np.stack(masks), cameras))
            yield sitter.name


def _is_there(place: Path, views: int, size: int) -> bool:
    """Whether an object's folder holds this many pictures of this size."""
    pictures = list((place / "rgb").glob("*.png"))
    if len(pictures) != views:
        return False
    with Image.open(pictures[0]) as opened:
        return opened.size == (size, size)
