"""Thumbnails of photo files, read by the worker."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import ImageOps

from core.photos.decode import on_white
from core.runtime.reading import open_image
from viewer.services.jobs import Jobs
from viewer.services.worker import Job

_SIDE = 128  # px


class PhotoThumbnails:
    """Thumbnails of photo files by path; each file is read once."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._pixels: dict[Path, UInt8[np.ndarray, "side side 3"] | None] = {}

    def get(self, path: Path) -> UInt8[np.ndarray, "side side 3"] | None:
        """Return the whole photo in a white square; None until it is read.

        It stays None for an unreadable file, which its fit reports.
        """
        if path not in self._pixels:
            self._pixels[path] = None
            self._jobs.submit(Job(f"photo {path}", lambda: (_square(path),), partial(self._pixels.__setitem__, path)))
        return self._pixels[path]


def _square(path: Path) -> UInt8[np.ndarray, "side side 3"]:
    with open_image(path, _SIDE) as image:
        small = ImageOps.exif_transpose(image)
        small.thumbnail((_SIDE, _SIDE))
        return np.asarray(ImageOps.pad(on_white(small), (max(small.size),) * 2, color="white"))
