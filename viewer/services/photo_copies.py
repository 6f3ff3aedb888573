"""Copies of photos: of files to be fitted, which may change or go, and of the whole photos of fitted objects."""

import hashlib
import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.models.photo_detail import PhotoView
from core.runtime.files import atomic_file
from core.runtime.reading import optional, read_bytes
from viewer.values.cut_out_preview import CutOutPreview, read_compressed
from viewer.values.fit_history import PhotoSource

_MAX_KEPT = 50  # copies of each kind kept beside those that are needed


class PhotoCopies:
    """Copies photo files into a folder each, and whole photos into small files, named after their content."""

    def __init__(self, folder: Path | None = None) -> None:
        """Copy into ``folder``; None copies nothing."""
        self._folder = folder
        self._read: tuple[PhotoView, UInt8[np.ndarray, "height width 3"] | None] | None = None  # whole photo read last

    def keep(self, source: PhotoSource) -> PhotoSource:
        """Return a photo with a copy of its file; unchanged if the file or the folder denies that."""
        if self._folder is None:
            return source
        with suppress(ValueError, OSError):
            content = read_bytes(source.file)
            copy = self._folder / _digest(content) / source.path.name
            _write_copy(copy, content)
            return source._replace(copy=copy)
        return source

    def keep_image(self, source: PhotoSource, image: Image.Image) -> PhotoSource:
        """Return a photo whose copy is an image, such as a frame; it is not written if the folder denies that."""
        encoded = BytesIO()
        image.save(encoded, "PNG", compress_level=1)
        content = encoded.getvalue()
        copy = (self._folder or Path()) / _digest(content) / f"{source.path.stem}.png"
        if self._folder:
            with suppress(ValueError, OSError):
                _write_copy(copy, content)
        return source._replace(copy=copy)

    def keep_photo(self, view: PhotoView, preview: CutOutPreview) -> None:
        """Keep the whole photo of which a fitted object holds a view, unless the folder denies that."""
        self._read = None
        if path := self._photo_file(view):
            with suppress(ValueError, OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                with atomic_file(path) as written:
                    written.write_bytes(preview.compressed)

    def photo_of(self, view: PhotoView) -> UInt8[np.ndarray, "height width 3"] | None:
        """Return the whole photo of a fitted object's view; None if no copy of it is there."""
        path = self._photo_file(view)
        if path and (self._read is None or self._read[0].image is not view.image):
            self._read = view, optional(lambda: read_compressed(path.read_bytes()))
        return self._read[1] if self._read else None

    def _photo_file(self, view: PhotoView) -> Path | None:
        return self._folder and self._folder / f"{_digest(view.image)}.webp"

    def sweep(self, needed: Iterable[PhotoSource], views: Iterable[PhotoView] = ()) -> None:
        """Delete the oldest copies beyond a limit, except those of some photos, and of objects with some views."""
        paths = sorted(self._folder.glob("*"), key=lambda path: path.stat().st_mtime) if self._folder else []
        kept = {source.copy.parent for source in needed if source.copy} | set(map(self._photo_file, views))
        for path in [path for path in paths if path.is_dir()][:-_MAX_KEPT]:
            if path not in kept:
                shutil.rmtree(path, ignore_errors=True)
        for path in [path for path in paths if not path.is_dir()][:-_MAX_KEPT]:
            if path not in kept:
                path.unlink(missing_ok=True)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _write_copy(copy: Path, content: bytes) -> None:
    """Write a copy unless it is there, and make its folder the newest."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    if not copy.exists():
        with atomic_file(copy) as written:
            written.write_bytes(content)
    os.utime(copy.parent)
