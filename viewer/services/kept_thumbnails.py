"""Small pictures kept from one launch to the next: a file for each model's objects, and one for the session."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from core.models.model import Model
from core.runtime.files import atomic_file

_FORMAT = "thumbnails-1"  # another one where renders look different
Pixels = UInt8[np.ndarray, "height width 4"]


class KeptThumbnails:
    """Pictures (rgb on white, and opacity) by a text that says all that they depend on."""

    def __init__(self, folder: Path | None = None) -> None:
        """``folder`` None keeps nothing."""
        self._folder = folder

    def load(self, model: Model) -> dict[str, Pixels]:
        """Those of a model; none where they cannot be read."""
        return read_pictures(self._path(model)) if self._folder else {}

    def save(self, model: Model, pictures: Mapping[str, Pixels]) -> None:
        """Keep these and no others of a model, where the folder can be written to."""
        if self._folder:
            write_pictures(self._path(model), pictures)

    def _path(self, model: Model) -> Path:
        assert self._folder is not None, "nothing is kept"
        return self._folder / f"{model.fingerprint}.{_FORMAT}.safetensors"


def read_pictures(path: Path) -> dict[str, Pixels]:
    """The pictures in a file; none where it cannot be read."""
    with suppress(OSError, SafetensorError, ValueError):
        return {key: one for key, one in load_file(path).items() if one.dtype == np.uint8 and one.shape[2:] == (4,)}
    return {}


def write_pictures(path: Path, pictures: Mapping[str, Pixels]) -> None:
    """Write pictures into a file, where that can be."""
    with suppress(OSError, SafetensorError, ValueError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as partial:
            save_file(dict(pictures), partial)
