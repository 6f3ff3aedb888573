"""Copies of photo files while the program runs: their files may change or go. The store has their contents."""

import shutil
import tempfile
import weakref
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from PIL import Image

from core.runtime.files import atomic_file
from core.runtime.reading import read_bytes
from viewer.store.blobs import digest_of
from viewer.values.fit_history import PhotoSource

MAX_PHOTO_FILE = 64_000_000  # bytes of a file that is kept; SQLite has at most a gigabyte in a row


class PhotoCopies:
    """Copies photos into a temporary folder, in folders named after their content."""

    def __init__(self) -> None:
        self._folder: Path | None = None

    def keep(self, source: PhotoSource, image: Image.Image | None = None) -> PhotoSource:
        """Return a photo with a copy of its file or of an image; unchanged if the file or the folder denies that."""
        with suppress(ValueError, OSError):
            if image is None:
                return source._replace(copy=self.write(read_bytes(source.file, MAX_PHOTO_FILE), source.path.name))
            encoded = BytesIO()
            image.save(encoded, "PNG", compress_level=1)
            return source._replace(copy=self.write(encoded.getvalue(), f"{source.path.stem}.png"))
        return source

    def write(self, content: bytes, name: str) -> Path:
        """Write a copy unless it is there, and return its path. Raises ``ValueError`` or ``OSError`` on failure."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="codenerf-photos-"))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        path = self._folder / digest_of(content).hex() / name
        path.parent.mkdir(exist_ok=True)
        if not path.exists():
            with atomic_file(path) as written:
                written.write_bytes(content)
        return path
