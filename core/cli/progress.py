"""What commands share: a progress bar, and a check of where the result goes."""

from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from core.models.threads import with_measured_threads


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream to its end under a progress bar, which appears with the first value."""
    stream = with_measured_threads(stream)
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def require_writable(path: Path) -> None:
    """Check before the work that its result can be written.

    Raises ``ValueError`` where the path is a folder or its folder does not exist.
    """
    if path.is_dir():
        raise ValueError(f"cannot write {path}: it is a folder")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"cannot write {path}: there is no folder {path.parent}")
