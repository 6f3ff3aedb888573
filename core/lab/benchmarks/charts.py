"""The charts of the benchmarks, one style for all: colours that the colour-blind tell apart, on white in dark mode too.

Chairs and cars have a colour and a marker each; n and date stand in the corner.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from core.fitting.confidence import RIGHT_DEGREES
from core.lab.benchmarks.fits import DEFAULT, LEVELS, SPEED
from core.lab.benchmarks.frames import SIZES
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.protocol import Mean, mean_of

Frames = Mapping[str, pd.DataFrame]  # the rows of each benchmark

_DPI = 100
_GREY = "#555555"
_STYLE = {"chairs": ("#0072b2", "o"), "cars": ("#d55e00", "s")}  # of Okabe and Ito's palette
_OTHER = ("#009e73", "^")  # of another category
_RENDERERS = {"exact": ("#000000", "o"), "fast": ("#0072b2", "s"), "baked": ("#d55e00", "^")}
_PHOTOS = {1: ("#0072b2", "o"), 2: ("#e69f00", "s"), 3: ("#009e73", "^"), 5: ("#cc79a7", "D")}


def _figure(columns: int, rows: int = 1, width: float = 4.6, ratio: float = 0.8) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure and its axes, row by row, each ``width`` inches wide."""
    figure = Figure(figsize=(width * columns, ratio * width * rows), layout="constrained", facecolor="white")
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in panels:
        axes.grid(alpha=0.25)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels


def _sign(figure: Figure, frame: pd.DataFrame, *words: str) -> None:
    """Write the number of objects and trials, the date and the processor into the corner."""
    counts = ", ".join(f"{group.name.nunique()} {kind}" for kind, group in frame.groupby("category", sort=False))
    origin = f"{counts}; {frame.date.max()}, {frame.commit.iloc[-1]}; {frame.processor.iloc[-1]}"
    figure.supxlabel("; ".join((*words, origin)), fontsize=7, color=_GREY, x=0.995, ha="right")


def _log_scale(axes: Axes, *names: str) -> None:
    """Make the axes x, y or both logarithmic, with plain numbers at 1, 2 and 5 of every decade."""
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        axis.set_minor_locator(NullLocator())


def _by_category(frame: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame, str, str]]:
    """Yield each category, its rows, its colour and its marker."""
    for kind, group in frame.groupby("category", sort=False):
        yield str(kind), group, *_STYLE.get(str(kind), _OTHER)


def _label(axes: Axes, text: str, point: Iterable[float], colour: str, shift: tuple[int, int] = (5, 4)) -> None:
    """Write small text beside a point, ``shift`` points (1/72 inch) to the right of it and above."""
    x, y = point
    axes.annotate(text, (x, y), shift, textcoords="offset points", fontsize=7, color=colour)


def _bars(mean: Mean) -> list[list[float]]:
    """Return the interval's distances below and above its mean, as matplotlib's error bars take them."""
    return [[mean.mean - mean.low], [mean.high - mean.mean]]


def pareto(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points of (cost, worth) that no other one beats in both, by cost.

    Example:
        >>> pareto([(3.0, 1.0), (1.0, 2.0), (2.0, 5.0)])
        [(1.0, 2.0), (2.0, 5.0)]
    """
    best: list[tuple[float, float]] = []
    for cost, worth in sorted(points, key=lambda point: (point[0], -point[1])):
        if not best or worth > best[-1][1]:
            best.append((cost, worth))
    return best


def _speed_chart(frames: Frames) -> Figure:
    """Draw the time of a fit against degrees and against dB of other views, with the Pareto line."""
    trials = frames["fits"][frames["fits"].case.isin(SPEED)]
    figure, (left, right) = _figure(2)
    for (kind, group, colour, marker), shift in zip(_by_category(trials), cycle((5, -11)), strict=False):
        methods = {name: group[group.case == name] for name in SPEED if (group.case == name).any()}
        seconds = {name: method.seconds.median() for name, method in methods.items()}
        worth = {name: mean_of(method["novel.psnr"]) for name, method in methods.items()}
        for name, method in methods.items():
            size = 11 if name == DEFAULT else 5
            error = max(method.rotation.median(), 0.1)
            left.plot(seconds[name], error, marker, color=colour, ms=size)
            _label(left, name, (seconds[name], error), colour, (5, shift))
            point = (seconds[name], worth[name].mean)
            right.errorbar(*point, _bars(worth[name]), fmt=marker, color=colour, ms=size, lw=0.6)
            _label(right, f"{name} (default)" if name == DEFAULT else name, point, colour, (5, shift))
        line = pareto([(seconds[name], worth[name].mean) for name in methods])
        right.plot(*zip(*line, strict=True), color=colour, alpha=0.5, label=kind)
        left.plot([], [], marker, color=colour, label=kind)
    left.set(ylabel="error of the camera (degrees, median)")
    left.axhline(RIGHT_DEGREES, color=_GREY, lw=0.6, ls=":")
    right.set(ylabel="other views (dB, 95 % intervals)")
    right.margins(x=0.15)
    for axes in (left, right):
        axes.set_xlabel("seconds of one core (median)")
        _log_scale(axes, "x")
    _log_scale(left, "y")
    left.legend(fontsize=8)
    _sign(figure, trials, "cameras unknown")
    return figure


def _frames_chart(frames: Frames) -> Figure:
    timings = frames["frames"]
    figure, panels = _figure(len(SIZES), width=3.6, ratio=1.0)
    for axes, size in zip(panels, SIZES, strict=True):
        for renderer, (colour, marker) in _RENDERERS.items():
            group = timings[(timings["size"] == size) & (timings.renderer == renderer)]
            means = group.groupby("samples")[["milliseconds", "psnr"]].mean()
            axes.plot(means.milliseconds, means.psnr, f"{marker}-", color=colour, label=renderer)
            for samples, row in means.iterrows():
                _label(axes, f"{samples}", row, colour, (4, 4))
        axes.set(title=f"{size} px", xlabel="processor ms of an image")
        axes.margins(x=0.2)
        if (timings["size"] == size).any():
            _log_scale(axes, "x")
            axes.xaxis.set_major_locator(LogLocator())
    panels[0].set_ylabel("dB to the exact render of 512 samples")
    panels[0].legend(fontsize=8)
    _sign(figure, timings, "numbers: samples of a ray, cells of a side")
    return figure


def _exports_chart(frames: Frames) -> Figure:
    trials = frames["exports"]
    figure, (axes,) = _figure(1, width=5.6)
    for kind, group, colour, marker in _by_category(trials):
        means = group.groupby("case", sort=False)[["seconds", "megabytes"]].mean()
        axes.plot(means.seconds, means.megabytes, marker, color=colour, label=kind)
        for name, row in means.iterrows():
            _label(axes, str(name), row, colour)
    axes.set(xlabel="seconds of one core (mean)", ylabel="size of the file (MB, mean)")
    axes.margins(0.15)
    _log_scale(axes, "x", "y")
    axes.legend(fontsize=8)
    _sign(figure, trials)
    return figure


def _stability_chart(frames: Frames) -> Figure:
    """Draw successes against how wrong the input is: a panel for each stressor.

    Lines are fractions of right cameras, dotted for the paper's recipe; bars are the doubted fraction of wrong results.
    """
    trials = frames["stability"]
    baseline = frames["fits"]
    figure, panels = _figure(4, -(-len(STRESSORS) // 4), width=2.9)
    for axes, (name, stressor) in zip(panels, STRESSORS.items(), strict=False):
        for index, kind in enumerate(trials.category.unique()):
            colour, marker = _STYLE.get(kind, _OTHER)
            rows = trials[(trials.category == kind) & (trials.stressor == name)]
            for method, dashes in (("normal", "-"), ("paper", ":")):
                clean = baseline[(baseline.category == kind) & (baseline.case == method)]
                levels = rows[rows.method == method].groupby("level").right.mean()
                if not stressor.stranger and len(clean) and (len(levels) or method == "paper"):
                    levels.loc[stressor.harmless] = clean.right.mean()
                levels = 100 * levels.sort_index()
                label = f"{kind}, {method}"
                axes.plot(levels.index, levels, f"{marker}{dashes}", color=colour, ms=5, label=label)
            wrong = rows[(rows.method == DEFAULT) & ~rows.right]
            doubted = 100 * wrong.groupby("level").doubted.mean()
            span = max(stressor.levels) - min((*stressor.levels, 0.0)) or 1.0
            offset = (index - 0.5) * 0.06 * span
            axes.bar(doubted.index + offset, doubted, 0.05 * span, color=colour, alpha=0.25)
        axes.set(ylim=(-4, 104), yticks=(0, 50, 100))
        if len(stressor.levels) == 1:
            axes.set(xlim=(-0.3, 1.3), xticks=(0, 1), xticklabels=("right", "wrong"))
        axes.set_title(stressor.title, fontsize=9)
        axes.set_xlabel(stressor.unit, fontsize=8)
    for axes in panels[len(STRESSORS) :]:
        axes.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    figure.supylabel(f"cameras within {RIGHT_DEGREES:g}° (%); bars: doubted among the wrong (%)", fontsize=9)
    _sign(figure, trials)
    return figure


def _freedom_chart(frames: Frames) -> Figure:
    """Draw dB of other views against the numbers that are free, a line for each number of photos."""
    trials = level_rows(frames["fits"])
    kinds = list(trials.category.unique())
    figure, panels = _figure(len(kinds))
    for axes, kind in zip(panels, kinds, strict=True):
        group = trials[trials.category == kind]
        free = group.groupby("level", sort=False).free.first()
        for photos, (colour, marker) in _PHOTOS.items():
            rows = group[group.photos == photos]
            levels = [level for level in LEVELS if (rows.level == level).any()]
            means = [mean_of(rows["novel.psnr"][rows.level == level]) for level in levels]
            positions = [LEVELS.index(level) for level in levels]
            label = f"{photos} photo{'s' if photos > 1 else ''}"
            if means:
                values = [mean.mean for mean in means]
                bars = np.hstack([_bars(mean) for mean in means])
                axes.errorbar(positions, values, bars, fmt=f"{marker}-", color=colour, lw=1, ms=5, label=label)
        ticks = [f"{level}\n{free[level]:,}" if level in free else level for level in LEVELS]
        axes.set_xticks(range(len(LEVELS)), ticks, fontsize=7)
        axes.set(title=kind, xlabel="free numbers of an object", ylabel="other views (dB, 95 % intervals)")
        axes.legend(fontsize=8)
    _sign(figure, trials, "cameras known")
    return figure


def level_rows(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the fits whose freedom differs, with their level."""
    split = trials.case.str.rsplit(", ", n=1).str[0]
    return trials.assign(level=split)[split.isin(LEVELS)]


class Chart(NamedTuple):
    """A figure, its description, and the benchmarks whose rows it shows."""

    figure: Callable[[Frames], Figure]
    title: str
    benchmarks: tuple[str, ...]


CHARTS = {
    "speed": Chart(_speed_chart, "Seconds of one core against degrees and dB, by method", ("fits",)),
    "frames": Chart(_frames_chart, "Milliseconds against dB to the exact render, by renderer", ("frames",)),
    "exports": Chart(_exports_chart, "Seconds against size, by kind of file", ("exports",)),
    "stability": Chart(_stability_chart, "Right cameras against how wrong the input is", ("stability", "fits")),
    "freedom": Chart(_freedom_chart, "dB of other views against the numbers that are free, by photos", ("fits",)),
}  # by file name


def draw(frames: Frames, folder: Path) -> list[Path]:
    """Write all charts whose rows were measured as PNG files; return these."""
    drawn = []
    for name, chart in CHARTS.items():
        if set(chart.benchmarks) <= set(frames):
            path = folder / f"{name}.png"
            chart.figure(frames).savefig(path, dpi=_DPI, metadata={"Software": ""})
            drawn.append(path)
    return drawn
