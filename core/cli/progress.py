"""Progress bars of commands."""

from collections.abc import Iterator

from tqdm import tqdm

from core.models.model import Model


def run_with_progress(stream: Iterator[object], total: int, unit: str) -> None:
    """Run a stream of ``total`` values under a progress bar in units of a value.

    The bar appears with the first value, so that errors come first.
    """
    next(stream, None)
    with tqdm(total=total, unit=unit, initial=1, disable=None) as bar:
        for _ in stream:
            bar.update()


def wait_for_view_bank(model: Model) -> None:
    """Compute the view bank under a progress bar if the model's file has none."""
    from core.photos.view_bank import build_view_bank  # imported late: videos do not need it

    with tqdm(desc="view bank", total=1.0, bar_format="{desc} {percentage:.0f} %", leave=False, disable=None) as bar:
        for fraction in build_view_bank(model):
            bar.update(fraction - bar.n)
