"""Progress bars and warnings of commands."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tqdm import tqdm

from core.models.model import Model
from core.runtime.program import program_name
from core.streams import run_to_end

if TYPE_CHECKING:
    from core.photos.view_bank import ViewBank


def warn(text: str) -> None:
    """Print a line to stderr, after the name of the command."""
    print(f"{program_name('core', 'codenerf')}: {text}", file=sys.stderr)


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream of ``total`` values under a progress bar in units of a value.

    The bar appears with the first value, so that errors come first.
    """
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def wait_for_view_bank(model: Model) -> "ViewBank":
    """Build the model's view bank under a progress bar, or read it from the cache folder."""
    from core.photos.view_bank import build_view_bank  # imported late: videos do not need it

    with tqdm(desc="view bank", total=1.0, bar_format="{desc} {percentage:.0f} %", leave=False, disable=None) as bar:
        return run_to_end(build_view_bank(model), lambda share: bar.update(share - bar.n))
