"""What commands share: progress on the screen, and a place for the result."""

from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm


def drive(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream to its end under a progress bar, which appears once the first value is there and all is well."""
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def require_place(path: Path) -> None:
    """Raises ``ValueError`` where a file cannot be written for want of its folder, or because it is one itself: before
    the work, not after it.
    """
    if path.is_dir():
        raise ValueError(f"cannot write {path}: it is a folder")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"cannot write {path}: there is no folder {path.parent}")
