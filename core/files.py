"""Files that are there whole or not at all, numbers as JSON, and the folder of what can be made again."""

import json
import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from platformdirs import user_cache_path

VIEW_BANKS = "view-banks"
"""folder of the cache folder"""
_CACHE_VARIABLE = "CODENERF_CACHE"
"""of the environment: another folder than the platform's"""


def cache_folder() -> Path:
    """The folder for what takes long to make and can be made again: ``CODENERF_CACHE``, else the platform's own."""
    named = os.environ.get(_CACHE_VARIABLE)
    return Path(named) if named else user_cache_path("codenerf-viewer", appauthor=False)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """A place beside ``path`` to write to, renamed to it at the end and removed should the end not come.

    Of processes that write the same file at once the last one wins, whole. Raises ``ValueError`` naming ``path`` where
    it cannot be written.
    """
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        partial.touch()  # at once, so that a place that cannot be written to is refused before the work
        yield partial
        partial.replace(path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path, replace: bool = False) -> Iterator[Path]:
    """A new folder beside ``path`` to write to, as :func:`atomic_file`.

    Raises ``ValueError`` naming ``path`` where it cannot be written, or is there already and not to be replaced.
    """
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    if path.exists() and not replace:
        raise ValueError(f"cannot write {path}: it is there already")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        yield partial
        shutil.rmtree(path, ignore_errors=True)
        partial.rename(path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from None
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
