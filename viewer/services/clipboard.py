"""Images from and to the clipboard: pixels, or copied files; and the files that dropped or pasted text names."""

import base64
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes, urlparse

import copykitten
import numpy as np
from jaxtyping import UInt8
from PIL import ImageGrab

_MAX_KEPT = 50  # files in the folder
_LONGEST_PATH = 4096  # characters
_LONGEST_DATA = 100_000_000  # characters of a data address


class Clipboard:
    """Reads images; pasted pixels are saved as files, so that they can be fitted again later."""

    def __init__(self, folder: Path | None = None) -> None:
        """Save pasted pixels in ``folder``, which keeps the newest files; None: among the temporary files."""
        self._folder = folder or Path(tempfile.gettempdir()) / "codenerf-viewer"

    def images(self, text: str) -> Iterator[tuple[Path, ...]]:
        """Yield the clipboard's image files, all at once, or those that its text names; reading may start a program.

        Raises ``ValueError`` if there is no image.
        """
        if named := self._named(text):
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

    def file(self, text: str) -> Path:
        """Return the file that a text names: a path, a file:// address, or a data address, whose content is saved.

        Raises ``ValueError`` for a text that is too long for a path, or a data address that cannot be decoded.
        """
        if text.startswith("data:"):
            path = self._free_path(_suffix(text))
            path.write_bytes(_data(text))
            return path
        if len(text) > _LONGEST_PATH:
            raise ValueError(f"a text of {len(text):,} characters names no file: {text[:40]}…")
        return Path(unquote(urlparse(text).path)) if text.startswith("file://") else Path(text)

    def _named(self, text: str) -> tuple[Path, ...]:
        """Return the files named by lines of text; none unless all exist."""
        try:
            lines = [text] if text.startswith("data:") else text.splitlines()
            paths = [self.file(line.strip()) for line in lines if line.strip()]
            return tuple(paths) if all(path.is_file() for path in paths) else ()
        except (OSError, ValueError):  # too long, or not a path
            return ()

    def _free_path(self, suffix: str = ".png") -> Path:
        """Return a new path and delete the oldest files beyond the limit."""
        self._folder.mkdir(parents=True, exist_ok=True)
        numbers = {path: path.stem.removeprefix("pasted ") for path in self._folder.glob("pasted *")}
        pasted = {int(number): path for path, number in numbers.items() if number.isdecimal()}
        for number in sorted(pasted)[: -_MAX_KEPT + 1]:
            pasted[number].unlink(missing_ok=True)
        return self._folder / f"pasted {max(pasted, default=0) + 1}{suffix}"


def copy_image(image: UInt8[np.ndarray, "height width 3"]) -> None:
    """Copy an image to the clipboard. Raises ``ValueError`` if the clipboard cannot be written."""
    height, width = image.shape[:2]
    opaque = np.full((height, width, 1), 255, np.uint8)
    try:
        copykitten.copy_image(np.concatenate((image, opaque), -1).tobytes(), width, height)
    except copykitten.CopykittenError as error:
        raise ValueError(f"the clipboard cannot be written ({error})") from None


def _suffix(address: str) -> str:
    """Return the ending of a data address's kind of file, such as ".jpeg"."""
    kind = address[: address.find(",")].partition(";")[0].rpartition("/")[2]
    return f".{kind}" if kind.isalnum() else ".png"


def _data(address: str) -> bytes:
    """Decode a data address (RFC 2397). Raises ``ValueError``."""
    head, _, content = address.partition(",")
    if len(address) > _LONGEST_DATA:
        raise ValueError(f"a data address has at most {_LONGEST_DATA / 1e6:.0f} MB")
    data = unquote_to_bytes(content)
    return base64.b64decode(data + b"==") if head.endswith(";base64") else data
