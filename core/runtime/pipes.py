"""Inputs that can be read only once, such as /dev/stdin. Imports nothing large, as every command's parser needs it."""

import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

_LARGEST = 400_000_000  # bytes, as of files (:data:`core.runtime.reading.MAX_DECODED`)


def as_file(path: Path) -> Path:
    """Return the path of a file; of a pipe, that of a copy of its content, kept until the process ends.

    Raises ``ValueError`` for too much content.
    """
    if not _has_kind(path, stat.S_ISFIFO, stat.S_ISSOCK):
        return path
    with path.open("rb") as pipe:
        content = pipe.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise ValueError(f"{path}: more than {_LARGEST / 1e6:.0f} MB came out of this pipe")
    folder = Path(tempfile.mkdtemp(dir=_folder().name))  # two pipes may have the same name
    (folder / path.name).write_bytes(content)
    return folder / path.name


def refuse_pipe(path: Path) -> None:
    """Raise ``ValueError`` for a pipe or a device: files are opened several times, and a pipe may block for ever."""
    if _has_kind(path, stat.S_ISFIFO, stat.S_ISSOCK, stat.S_ISCHR):
        raise ValueError(f"{path} is a pipe or a device: write its content to a file first")


def _has_kind(path: Path, *kinds: Callable[[int], bool]) -> bool:
    with suppress(OSError, ValueError):  # no such file, or no path
        mode = path.stat().st_mode
        return any(kind(mode) for kind in kinds)
    return False


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    return tempfile.TemporaryDirectory(prefix="codenerf-")
