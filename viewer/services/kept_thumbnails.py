"""Thumbnails kept between launches: a file for each model's objects, and one for the session."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from core.models.model import Model
from core.runtime.files import atomic_file

_FORMAT = "thumbnails-1"  # changes when renders look different
Pixels = UInt8[np.ndarray, "height width 4"]


class KeptThumbnails:
    """Stores images (rgb on white, and opacity) under keys that describe everything they depend on."""

    def __init__(self, folder: Path | None = None) -> None:
        """``folder`` None stores nothing."""
        self._folder = folder

    def load(self, model: Model) -> dict[str, Pixels]:
        """Load the thumbnails of a model; none if unreadable."""
        return read_pictures(self._path(model)) if self._folder else {}

    def save(self, model: Model, thumbnails: Mapping[str, Pixels]) -> None:
        """Store exactly these thumbnails of a model, if the folder is writable."""
        if self._folder:
            write_pictures(self._path(model), thumbnails)

    def _path(self, model: Model) -> Path:
        assert self._folder is not None, "nothing is kept"
        return self._folder / f"{model.fingerprint}.{_FORMAT}.safetensors"


def read_pictures(path: Path) -> dict[str, Pixels]:
    """Load the pictures of a file by their names; none if unreadable."""
    with suppress(OSError, SafetensorError, ValueError):
        return {key: one for key, one in load_file(path).items() if one.dtype == np.uint8 and one.shape[2:] == (4,)}
    return {}


def write_pictures(path: Path, pictures: Mapping[str, Pixels]) -> None:
    """Store pictures in a file, if its folder is writable."""
    with suppress(OSError, SafetensorError, ValueError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as partial:
            save_file(dict(pictures), partial)
