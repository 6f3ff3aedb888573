"""Copies of photos to be fitted, which may wait long after their files have changed or gone."""

import hashlib
import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from core.runtime.files import atomic_file
from core.runtime.reading import read_bytes
from viewer.values.fit_history import PhotoSource

_MAX_KEPT = 50  # copies kept beside those of unfinished fits


class PhotoCopies:
    """Copies photo files into a folder each, named after their content."""

    def __init__(self, folder: Path | None = None) -> None:
        """Copy into ``folder``; None copies nothing."""
        self._folder = folder

    def keep(self, source: PhotoSource) -> PhotoSource:
        """Return a photo with a copy of its file; unchanged if the file or the folder denies that."""
        if self._folder is None:
            return source
        with suppress(ValueError, OSError):
            content = read_bytes(source.file)
            copy = self._folder / hashlib.sha256(content).hexdigest()[:16] / source.path.name
            copy.parent.mkdir(parents=True, exist_ok=True)
            if not copy.exists():
                with atomic_file(copy) as written:
                    written.write_bytes(content)
            os.utime(copy.parent)  # the newest
            return source._replace(copy=copy)
        return source

    def sweep(self, needed: Iterable[PhotoSource]) -> None:
        """Delete the oldest copies beyond a limit, except those of some photos."""
        folders = [path for path in self._folder.glob("*") if path.is_dir()] if self._folder else []
        kept = {source.copy.parent for source in needed if source.copy}
        for folder in sorted(folders, key=lambda path: path.stat().st_mtime)[:-_MAX_KEPT]:
            if folder not in kept:
                shutil.rmtree(folder, ignore_errors=True)
