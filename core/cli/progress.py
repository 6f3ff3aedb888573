"""The progress bar of commands."""

from collections.abc import Iterator

from tqdm import tqdm

from core.models.threads import with_measured_threads


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream to its end under a progress bar, which appears with the first value."""
    stream = with_measured_threads(stream)
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()
