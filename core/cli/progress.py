"""Progress bars of commands."""

from collections.abc import Iterator

from tqdm import tqdm

from core.cli.output import collecting_lines
from core.models.model import Model


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


def wait_for_view_bank(model: Model) -> None:
    """Compute the view bank under a progress bar if the model's file has none."""
    from core.photos.view_bank import build_view_bank  # imported late: videos do not need it

    layout = "{desc} {percentage:.0f} %"
    with tqdm(desc="view bank", total=1.0, leave=False, disable=bars_disabled(), bar_format=layout) as bar:
        for fraction in build_view_bank(model):
            bar.update(fraction - bar.n)
