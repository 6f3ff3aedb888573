"""Images from the clipboard: pixels, or files that were copied."""

import shutil
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse

from PIL import ImageGrab


class Clipboard:
    """An image that is pasted is kept as a file, until the program ends."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._count = 0

    def images(self, text: str) -> Iterator[tuple[Path, ...]]:
        """The files, once: to be run as a job, as the system may have to start a program for it.

        Args:
            text: what the clipboard holds as text, which may name a file.

        Raises ``ValueError`` where there is no image.
        """
        if named := _named(text):
            yield named
            return
        try:
            found = ImageGrab.grabclipboard()
        except (OSError, NotImplementedError) as error:  # Linux needs wl-paste or xclip
            raise ValueError(f"the clipboard cannot be read ({error})") from None
        if isinstance(found, list):
            yield tuple(map(Path, found))
        elif found is not None:
            self._count += 1
            path = self._made_folder() / f"pasted {self._count}.png"
            found.save(path)
            yield (path,)
        else:
            raise ValueError("there is no image in the clipboard")

    def _made_folder(self) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="codenerf-viewer-"))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        return self._folder


def _named(text: str) -> tuple[Path, ...]:
    """The files that lines of text name, as paths or as file:// addresses; none unless all are there."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    paths = [Path(unquote(urlparse(line).path)) if line.startswith("file://") else Path(line) for line in lines]
    try:
        return tuple(paths) if all(path.is_file() for path in paths) else ()
    except (OSError, ValueError):  # too long for a path, or no path at all
        return ()
