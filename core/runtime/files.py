"""Files that are there whole or not at all, numbers as JSON, and the folder of what can be made again."""

import json
import math
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from platformdirs import user_cache_path

VIEW_BANKS, THUMBNAILS = "view-banks", "thumbnails"
"""folders of the cache folder"""
_CACHE_VARIABLE = "CODENERF_CACHE"
"""of the environment: another folder than the platform's"""


def cache_folder() -> Path:
    """The folder for what takes long to make and can be made again: ``CODENERF_CACHE``, else the platform's own."""
    named = os.environ.get(_CACHE_VARIABLE)
    return Path(named) if named else user_cache_path("codenerf-viewer", appauthor=False)


@contextmanager
def atomic_file(path: Path, check: Callable[[Path], object] | None = None) -> Iterator[Path]:
    """A place beside ``path`` to write to, renamed to it at the end and removed should the end not come.

    Args:
        check: reads what was written, before it takes the place of what was there.

    Of processes that write the same file at once the last one wins, whole. Raises ``ValueError`` naming ``path`` where
    it cannot be written, and where ``check`` does.
    """
    partial = _partial(path)
    try:
        partial.touch()  # at once, so that a place that cannot be written to is refused before the work
        yield partial
        _read_back(partial, check)
        partial.replace(path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # of a place that is gone, which would hide why
            partial.unlink(missing_ok=True)


def require_writable(path: Path) -> None:
    """Check before the work that its result can be written, by a file that is written and removed.

    Raises ``ValueError`` where the path is a folder, or its folder does not exist or takes no files.
    """
    if path.is_dir():
        raise ValueError(f"cannot write {path}: it is a folder")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"cannot write {path}: there is no folder {path.parent}")
    try:
        _partial(path).touch()
        _partial(path).unlink()
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from error


def save_or_elsewhere(save: Callable[[Path], None], path: Path) -> None:
    """Save what took long to make; where that cannot be, in the folder of temporary files.

    Raises ``ValueError`` then, which names both places.
    """
    try:
        save(path)
    except ValueError as error:
        other = Path(tempfile.mkdtemp(prefix="codenerf-")) / path.name
        save(other)
        raise ValueError(f"{error}; it is in {other} instead") from error


def _partial(path: Path) -> Path:
    """Beside a path, of the same ending; short, as a name has 255 bytes at the most."""
    ending = path.suffix if len(path.suffix) <= 16 else ""
    return path.with_name(f".{zlib.crc32(os.fsencode(path.name)):08x}-{os.getpid()}.partial{ending}")


def _read_back(partial: Path, check: Callable[[Path], object] | None) -> None:
    try:
        if check:
            check(partial)
    except ValueError as error:
        raise ValueError(f"what was written cannot be read back, and was not kept ({error})") from error


@contextmanager
def atomic_folder(path: Path, replace: bool = False) -> Iterator[Path]:
    """A new folder beside ``path`` to write to, as :func:`atomic_file`.

    Raises ``ValueError`` naming ``path`` where it cannot be written, or is there already and not to be replaced.
    """
    partial = _partial(path)
    if path.exists() and not replace:
        raise ValueError(f"cannot write {path}: it is there already")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        yield partial
        shutil.rmtree(path, ignore_errors=True)
        partial.rename(path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_json(path: Path, content: dict) -> None:
    """Numbers as JSON, what is not a number as null."""
    with atomic_file(path) as partial:
        partial.write_text(json.dumps(_without_nan(content), indent=1) + "\n")


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
