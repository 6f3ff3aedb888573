"""Atomic writing of files and folders, and numbers as JSON."""

import json
import math
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


@contextmanager
def atomic_file(path: Path, check: Callable[[Path], object] | None = None) -> Iterator[Path]:
    """Yield an empty file to write, which replaces ``path`` at the end, or is removed after an error.

    Symbolic links lead to their target, and an existing file keeps its mode. If processes write the same file at once,
    the last one wins completely. For a device, a pipe or standard output the content is copied.

    Args:
        check: reads the new file before it replaces the old one; a ``ValueError`` discards the new file.

    Raises ``ValueError`` naming ``path`` if it cannot be written, and another if ``check`` raises one.
    """
    with _naming(path):
        partial = _partial(path)  # first, so that an unwritable path is refused before the work
        try:
            yield partial
            _read_back(partial, check)
            _put(partial, path)
        finally:
            with suppress(OSError):  # a folder that has vanished must not hide the cause
                partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path, replace: bool = False) -> Iterator[Path]:
    """Yield a new folder to write to, like :func:`atomic_file`.

    Raises ``ValueError`` naming ``path`` if it cannot be written, or if it exists and ``replace`` is False.
    """
    target = Path(os.path.realpath(path))
    partial = _beside(target)
    former = _beside(target)
    if target.exists() and not replace:
        raise ValueError(f"cannot write {path}: it exists already")
    with _naming(path):
        try:
            partial.mkdir()
            yield partial
            with suppress(FileNotFoundError):
                target.rename(former)
            partial.rename(target)
        finally:
            for folder in (partial, former):
                shutil.rmtree(folder, ignore_errors=True)


def require_writable(path: Path) -> None:
    """Check before the work that its result can be written, by creating and removing a file.

    Raises ``ValueError`` if the path is a folder, or its folder does not exist or is not writable.
    """
    if path.is_dir():
        raise ValueError(f"cannot write {path}: it is a folder")
    if not Path(os.path.realpath(path)).parent.is_dir() and not is_stream(path):
        raise ValueError(f"cannot write {path}: there is no folder {path.parent}")
    with _naming(path):
        _partial(path).unlink()


def save_or_elsewhere(save: Callable[[Path], None], path: Path) -> None:
    """Save an expensive result; if ``path`` fails, save it in the folder of temporary files.

    Raises ``ValueError`` if ``path`` failed, naming the file in the temporary folder.
    """
    try:
        save(path)
    except ValueError as error:
        fallback = Path(tempfile.mkdtemp(prefix="codenerf-")) / path.name
        save(fallback)
        raise ValueError(f"{error}; it is in {fallback} instead") from error


def write_json(path: Path, content: dict) -> None:
    """Write a dictionary as JSON, atomically, with null for infinity and NaN."""
    with atomic_file(path) as partial:
        partial.write_text(json.dumps(_without_nan(content), indent=1) + "\n")


def is_stream(path: Path) -> bool:
    """True for a device, a pipe, or the target of this process's standard output or error."""
    with suppress(OSError):
        status = path.stat()
        plain = stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)
        return not plain or _standard(status) is not None
    return False


def open_output(path: Path) -> BinaryIO:
    """Open a file or a stream for incremental writing; standard output and error continue at their position."""
    standard = _standard(path.stat()) if path.exists() else None
    if standard is None:
        return path.open("wb")
    sys.stdout.flush()
    return os.fdopen(os.dup(standard), "wb")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from error


def _standard(status: os.stat_result) -> int | None:
    """Return the number (1 or 2) of the standard stream that is this file; None otherwise."""
    for number in (1, 2):
        with suppress(OSError):  # a closed stream
            if os.path.samestat(status, os.fstat(number)):
                return number
    return None


def _partial(path: Path) -> Path:
    """Create an empty file beside a path's target, with its mode; in the temporary folder for a stream."""
    if is_stream(path):
        partial = _beside(Path(tempfile.gettempdir()) / path.name)
        partial.touch(0o600, exist_ok=False)
        return partial
    target = Path(os.path.realpath(path))
    partial = _beside(target)
    partial.touch(exist_ok=False)
    if target.is_file():
        try:
            target.open("r+b").close()  # refuses a write-protected file
        except OSError:
            partial.unlink()
            raise
        with suppress(OSError):  # file systems without modes
            shutil.copymode(target, partial)
    return partial


def _beside(path: Path) -> Path:
    """Return an unused name in the same folder with the same ending, short enough for 255 bytes."""
    ending = path.suffix if len(path.suffix) <= 16 else ""
    return path.with_name(f".{secrets.token_hex(8)}.partial{ending}")


def _put(partial: Path, path: Path) -> None:
    """Replace the target by a finished file and flush it to disk; copy it if ``path`` is a stream."""
    if is_stream(path):
        with partial.open("rb") as source, open_output(path) as stream:
            shutil.copyfileobj(source, stream)
        return
    with partial.open("r+b") as file:
        os.fsync(file.fileno())
    partial.replace(os.path.realpath(path))


def _read_back(partial: Path, check: Callable[[Path], object] | None) -> None:
    try:
        if check:
            check(partial)
    except ValueError as error:
        raise ValueError(f"the new file cannot be read back and was discarded ({error})") from error


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
