"""Figures, axes and output folders of all charts. The extra ``bench`` brings matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from core.lab.evaluation.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

DPI = 110


def prepare(folder: Path) -> None:
    """Check, before hours of measuring, that charts can be drawn and written.

    Raise ``ValueError`` if matplotlib is missing, ``OSError`` if the folder cannot be made.
    """
    new_figure(1)
    folder.mkdir(parents=True, exist_ok=True)


def new_figure(columns: int, rows: int = 1, width: float = 5.2) -> tuple["Figure", Sequence["Axes"]]:
    """Return a figure and its axes, row by row, each ``width`` inches wide."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("charts need matplotlib: pip install -e '.[bench]'") from None
    figure = Figure(figsize=(width * columns, 0.8 * width * rows), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def log_ticks(axis: "Axis", places: Sequence[float] | None = None) -> None:
    """Write plain numbers at 1, 2 and 5 of every decade, or at ``places``, without minor labels."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

    axis.set_major_locator(FixedLocator(places) if places else LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def error_bars(means: Sequence[Mean]) -> list[list[float]]:
    """Return the intervals' distances below and above their means, as matplotlib's error bars take them."""
    return [[mean.mean - mean.low for mean in means], [mean.high - mean.mean for mean in means]]


def draw_frontier(axes: "Axes", points: Sequence[tuple[float, float]]) -> None:
    """Draw a line through the points of (cost, quality) that no other point beats in both."""
    best = frontier(points)
    axes.plot(*zip(*best, strict=True), "-", color="grey", linewidth=6, alpha=0.25, zorder=0, label="frontier")


def frontier(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points of (cost, quality) that no other beats in both, by cost.

    Example:
        >>> frontier([(3.0, 20.0), (1.0, 10.0), (2.0, 9.0)])
        [(1.0, 10.0), (3.0, 20.0)]
    """
    best: list[tuple[float, float]] = []
    for cost, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not best or quality > best[-1][1]:
            best.append((cost, quality))
    return best
