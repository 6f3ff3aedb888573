"""Progress bars of commands."""

from collections.abc import Generator, Iterator
from typing import TypeVar

from tqdm import tqdm

from core.cli.output import bars_disabled
from core.models.model import Model
from core.streams import run_to_end

_Result = TypeVar("_Result")


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream of ``total`` values under a progress bar, which appears with the first: errors come before it."""
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def run_with_fraction(stream: Generator[float, None, _Result], name: str) -> _Result:
    """Run a stream of finished fractions, 0..1, under a progress bar in percent; return its result."""
    layout = "{desc} {percentage:.0f} %"
    with tqdm(desc=name, total=1.0, leave=False, disable=bars_disabled(), bar_format=layout) as bar:
        return run_to_end(stream, lambda fraction: bar.update(fraction - bar.n))


def wait_for_view_bank(model: Model) -> None:
    """Compute the view bank under a progress bar if the model's file has none."""
    from core.photos.view_bank import build_view_bank  # imported late: videos do not need it

    run_with_fraction(build_view_bank(model), "view bank")
