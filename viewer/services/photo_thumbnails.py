"""Thumbnails of photo files."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import ImageOps

from core.photos.decode import on_white
from core.runtime.reading import open_image

_SIDE = 128  # px


def photo_thumbnail(path: Path) -> Iterator[UInt8[np.ndarray, "side side 3"]]:
    """Yield the whole photo in a white square. Raises ``ValueError`` for an unreadable file."""
    with open_image(path, _SIDE) as image:
        small = ImageOps.exif_transpose(image)
        small.thumbnail((_SIDE, _SIDE))
        square = ImageOps.pad(on_white(small), (max(small.size),) * 2, color="white")
    yield np.asarray(square)
