"""A file of images that are kept between launches."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from core.runtime.files import atomic_file

Pixels = UInt8[np.ndarray, "height width 4"]  # RGB on white, and opacity


def read_pictures(path: Path) -> dict[str, Pixels]:
    """Return a file's pictures by name; none if the file is missing or damaged."""
    with suppress(OSError, SafetensorError, ValueError):
        arrays = load_file(path)
        return {key: array for key, array in arrays.items() if array.dtype == np.uint8 and array.shape[2:] == (4,)}
    return {}


def write_pictures(path: Path, pictures: Mapping[str, Pixels]) -> None:
    """Replace a file of pictures; nothing happens if its folder is not writable."""
    with suppress(OSError, SafetensorError, ValueError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as partial:
            save_file(dict(pictures), partial)
