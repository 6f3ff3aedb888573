"""Images from and to the clipboard: pixels, or copied files."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse

import copykitten
import numpy as np
from jaxtyping import UInt8
from PIL import ImageGrab

_MAX_KEPT = 50  # files in the folder


class Clipboard:
    """Reads images; pasted pixels are saved as files, so that they can be fitted again later."""

    def __init__(self, folder: Path | None = None) -> None:
        """Save pasted pixels in ``folder``, which keeps the newest files; None: among the temporary files."""
        self._folder = folder or Path(tempfile.gettempdir()) / "codenerf-viewer"

    def images(self, text: str) -> Iterator[tuple[Path, ...]]:
        """Yield the clipboard's image files, all at once. Run as a job: reading may start a program.

        Args:
            text: the clipboard's text, which may name files.

        Raises ``ValueError`` if there is no image.
        """
        if named := _named(text):
            yield named
            return
        try:
            content = ImageGrab.grabclipboard()
        except (OSError, NotImplementedError) as error:  # Linux needs wl-paste or xclip
            raise ValueError(f"the clipboard cannot be read ({error})") from None
        if isinstance(content, list):
            yield tuple(map(Path, content))
        elif content is not None:
            path = self._free_path()
            content.save(path)
            yield (path,)
        else:
            raise ValueError("there is no image in the clipboard")

    def _free_path(self) -> Path:
        """Return a new path and delete the oldest files beyond the limit."""
        self._folder.mkdir(parents=True, exist_ok=True)
        numbers = {path: path.stem.removeprefix("pasted ") for path in self._folder.glob("pasted *.png")}
        pasted = {int(number): path for path, number in numbers.items() if number.isdecimal()}
        for number in sorted(pasted)[: -_MAX_KEPT + 1]:
            pasted[number].unlink(missing_ok=True)
        return self._folder / f"pasted {max(pasted, default=0) + 1}.png"


def copy_image(image: UInt8[np.ndarray, "height width 3"]) -> None:
    """Copy an image to the clipboard. Raises ``ValueError`` if the clipboard cannot be written."""
    height, width = image.shape[:2]
    opaque = np.full((height, width, 1), 255, np.uint8)
    try:
        copykitten.copy_image(np.concatenate((image, opaque), -1).tobytes(), width, height)
    except copykitten.CopykittenError as error:
        raise ValueError(f"the clipboard cannot be written ({error})") from None


def _named(text: str) -> tuple[Path, ...]:
    """Return the files named by lines of text, as paths or file:// URLs; none unless all exist."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    paths = [Path(unquote(urlparse(line).path)) if line.startswith("file://") else Path(line) for line in lines]
    try:
        return tuple(paths) if all(path.is_file() for path in paths) else ()
    except (OSError, ValueError):  # too long, or not a path
        return ()
