"""Progress bars of commands."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from tqdm import tqdm

from core.cli.output import collecting_lines
from core.models.model import Model
from core.streams import run_to_end

if TYPE_CHECKING:
    from core.photos.view_bank import ViewBank


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream of ``total`` values under a progress bar in units of a value.

    The bar appears with the first value, so that errors come first.
    """
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def bars_disabled() -> bool | None:
    """Return tqdm's ``disable``: True where lines are collected, None to show bars on terminals only."""
    return collecting_lines() or None


def wait_for_view_bank(model: Model) -> "ViewBank":
    """Build the model's view bank under a progress bar, or read it from the cache folder."""
    from core.photos.view_bank import build_view_bank  # imported late: videos do not need it

    about = {"desc": "view bank", "bar_format": "{desc} {percentage:.0f} %"}
    with tqdm(total=1.0, leave=False, disable=bars_disabled(), **about) as bar:
        return run_to_end(build_view_bank(model), lambda share: bar.update(share - bar.n))
