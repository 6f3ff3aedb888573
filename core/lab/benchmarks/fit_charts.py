"""Charts of the benchmarks that fit: presets, stressors and ablations."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from core.lab.benchmarks.fits import summarise_presets
from core.lab.benchmarks.robustness import SUCCESS_DEGREES, Rates, success_rates
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.benchmarks.tables import interval
from core.lab.evaluation.statistics import Mean


def _figure(columns: int, rows: int = 1, width: float = 5.2) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure and its axes, row by row, each ``width`` inches wide."""
    figure = Figure(figsize=(width * columns, 0.8 * width * rows), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _log_ticks(axis: Axis) -> None:
    """Write plain numbers at 1, 2 and 5 of every decade, without minor labels."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _error_bars(means: Sequence[Mean]) -> list[list[float]]:
    """Return the intervals' distances below and above their means, as matplotlib's error bars take them."""
    return [[mean.mean - mean.low for mean in means], [mean.high - mean.mean for mean in means]]


def fit_chart(trials: pd.DataFrame) -> Figure:
    """Draw rotation error and fraction of right cameras over time, and PSNR of other views against time."""
    figure, (left, middle, right) = _figure(3)
    summaries = summarise_presets(trials)
    for summary in summaries:
        # A curve ends with the results at the time at which half of the fits have ended.
        end = summary.seconds, summary.rotation, summary.within_5_degrees.mean
        curve = [point for point in summary.curve if point[0] < summary.seconds] + [end]
        seconds, rotations, fractions = zip(*curve, strict=True)
        left.plot(seconds, [max(rotation, 0.01) for rotation in rotations], "o-", label=summary.preset)
        middle.plot(seconds, [100 * fraction for fraction in fractions], "o-", label=summary.preset)
        place = summary.seconds, summary.held_out.mean
        right.errorbar(*place, _error_bars([summary.held_out]), fmt="o", capsize=2)
        label = f"{summary.preset} (default)" if summary.preset == "normal" else summary.preset
        right.annotate(label, place, (6, -12), textcoords="offset points", fontsize=8)
    left.set(xscale="log", yscale="log", xlabel="processor seconds", ylabel="rotation error (degrees, median)")
    middle.set(xscale="log", ylim=(-2, 102), xlabel="processor seconds", ylabel="cameras within 5 degrees (%)")
    right.set(xscale="log", xlabel="processor seconds (median)", ylabel="other views (dB, with 95 % intervals)")
    right.margins(x=0.25)
    for axes in (left, middle, right):
        _log_ticks(axes.xaxis)
        axes.grid(alpha=0.3)
    _log_ticks(left.yaxis)
    left.legend()  # in the middle it would hide points
    figure.suptitle(f"{trials.machine[0]}, {summaries[0].fits} views", fontsize=9)
    return figure


def ablations_chart(ablations: pd.DataFrame) -> Figure:
    """Draw time and accuracy of each ablation beside the full method."""
    rows = ablations.to_dict("records")
    names = [f"{row['summary.preset']} ({row['summary.fits']})" for row in rows]
    gains = [interval(row, "gain") for row in rows]
    figure, (left, right) = _figure(2)
    left.barh(names, ablations.time)
    left.axvline(1.0, color="black", linewidth=0.8)
    right.errorbar([gain.mean for gain in gains], names, xerr=_error_bars(gains), fmt="o", capsize=2)
    right.axvline(0.0, color="black", linewidth=0.8)
    left.invert_yaxis()
    left.set(xlabel="time (of the full method's)")
    right.set(xlabel="other views (dB over the full method's)", yticks=[], ylim=left.get_ylim())
    for axes in (left, right):
        axes.grid(alpha=0.3, axis="x")
        axes.set_axisbelow(True)
    figure.suptitle(f"{ablations.machine[0]}; views in brackets", fontsize=9)
    return figure


# Robustness


def robustness_chart(trials: pd.DataFrame) -> Figure:
    """Draw success rates: a panel per stressor, bars per level and preset."""
    names = trials.stressor.unique()
    columns = min(4, len(names))
    figure, panels = _figure(columns, -(-len(names) // columns), 2.9)
    for axes in panels[len(names) :]:
        axes.remove()
    rates = success_rates(trials)
    presets = list(trials.preset.unique())
    for axes, name in zip(panels, names, strict=False):
        _stressor_panel(axes, name, rates, presets)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    measure = f"cameras within {SUCCESS_DEGREES:g}°; without an object: refused or doubted (%)"
    figure.suptitle(f"{measure}; {trials.name.nunique()} objects; {trials.machine[0]}", fontsize=9)
    return figure


def _stressor_panel(axes: Axes, name: str, rates: Rates, presets: list[str]) -> None:
    levels = list(dict.fromkeys(level for stressor, level, _ in rates if stressor == name))
    for number, preset in enumerate(presets):
        fractions = [rates.get((name, level, preset), (0, 0, 0)) for level in levels]
        percentages = [Mean(*(100 * bound for bound in fraction)) for fraction in fractions]
        width = 0.8 / len(presets)
        centres = [index + (number - (len(presets) - 1) / 2) * width for index in range(len(levels))]
        means = [percentage.mean for percentage in percentages]
        axes.bar(centres, means, width, label=preset, yerr=_error_bars(percentages), error_kw={"linewidth": 0.8})
    axes.set_xticks(range(len(levels)), [f"{level:g}" for level in levels] if len(levels) > 1 else [""])
    middle = (len(levels) - 1) / 2
    half = max(3, len(levels)) / 2
    axes.set(xlim=(middle - half, middle + half), ylim=(0, 105), yticks=(0, 50, 100))
    axes.set_title(name, fontsize=10)
    axes.set_xlabel(STRESSORS[name].unit if name in STRESSORS else "", fontsize=8)
    axes.grid(alpha=0.3, axis="y")
    axes.set_axisbelow(True)
