"""Images kept between launches: a file of thumbnails per model, and a file of the session's pictures."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from core.models.model import Model
from core.runtime.files import atomic_file

_FORMAT = "thumbnails-1"  # to be raised when renders look different
Pixels = UInt8[np.ndarray, "height width 4"]  # RGB on white, and opacity


class KeptThumbnails:
    """Stores thumbnails of models' objects under keys that identify all their inputs."""

    def __init__(self, folder: Path | None = None) -> None:
        """Store in ``folder``; None stores nothing."""
        self._folder = folder

    def load(self, model: Model) -> dict[str, Pixels]:
        """Return a model's thumbnails by key; none if the file is missing or damaged."""
        return read_pictures(self._path(model)) if self._folder else {}

    def save(self, model: Model, thumbnails: Mapping[str, Pixels]) -> None:
        """Replace a model's stored thumbnails; nothing happens if the folder is not writable."""
        if self._folder:
            write_pictures(self._path(model), thumbnails)

    def _path(self, model: Model) -> Path:
        assert self._folder is not None, "nothing is kept"
        return self._folder / f"{model.fingerprint}.{_FORMAT}.safetensors"


def read_pictures(path: Path) -> dict[str, Pixels]:
    """Return a file's pictures by name; none if the file is missing or damaged."""
    with suppress(OSError, SafetensorError, ValueError):
        return {key: one for key, one in load_file(path).items() if one.dtype == np.uint8 and one.shape[2:] == (4,)}
    return {}


def write_pictures(path: Path, pictures: Mapping[str, Pixels]) -> None:
    """Replace a file of pictures; nothing happens if its folder is not writable."""
    with suppress(OSError, SafetensorError, ValueError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as partial:
            save_file(dict(pictures), partial)
