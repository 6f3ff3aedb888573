"""Charts of the benchmarks that fit: presets, stressors and ablations."""

from typing import TYPE_CHECKING

from core.lab.benchmarks.ablations import Ablation
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.drawing import draw_frontier, error_bars, log_ticks, new_figure
from core.lab.benchmarks.fits import FitTrial, summarise_presets
from core.lab.benchmarks.robustness import SUCCESS_DEGREES, RobustnessTrial, success_rates
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def fit_chart(results: Results[FitTrial]) -> "Figure":
    """Draw rotation error and fraction of right cameras over time, and PSNR of other views against time."""
    figure, (left, middle, right) = new_figure(3)
    summaries = summarise_presets(results.rows)
    for summary in summaries:
        # A curve ends with the results at the time at which half of the fits have ended.
        end = summary.seconds, summary.rotation, summary.within_5_degrees.mean
        curve = [point for point in summary.curve if point[0] < summary.seconds] + [end]
        seconds, rotations, fractions = zip(*curve, strict=True)
        left.plot(seconds, [max(rotation, 0.01) for rotation in rotations], "o-", label=summary.preset)
        middle.plot(seconds, [100 * fraction for fraction in fractions], "o-", label=summary.preset)
        place = summary.seconds, summary.held_out.mean
        right.errorbar(*place, error_bars([summary.held_out]), fmt="o", capsize=2)
        label = f"{summary.preset} (default)" if summary.preset == "normal" else summary.preset
        right.annotate(label, place, (6, -12), textcoords="offset points", fontsize=8)
    draw_frontier(right, [(summary.seconds, summary.held_out.mean) for summary in summaries])
    left.set(xscale="log", yscale="log", xlabel="processor seconds", ylabel="rotation error (degrees, median)")
    middle.set(xscale="log", ylim=(-2, 102), xlabel="processor seconds", ylabel="cameras within 5 degrees (%)")
    right.set(xscale="log", xlabel="processor seconds (median)", ylabel="other views (dB, with 95 % intervals)")
    right.margins(x=0.25)
    for axes in (left, middle, right):
        log_ticks(axes.xaxis)
        axes.grid(alpha=0.3)
    log_ticks(left.yaxis)
    left.legend()  # in the middle it would hide points
    figure.suptitle(f"{results.common['machine']}, {summaries[0].fits} views", fontsize=9)
    return figure


def ablations_chart(results: Results[Ablation]) -> "Figure":
    """Draw time and accuracy of each ablation beside the full method."""
    names = [f"{ablation.summary.preset} ({ablation.summary.fits})" for ablation in results.rows]
    gains = [ablation.gain for ablation in results.rows]
    figure, (left, right) = new_figure(2)
    left.barh(names, [ablation.time for ablation in results.rows])
    left.axvline(1.0, color="black", linewidth=0.8)
    right.errorbar([gain.mean for gain in gains], names, xerr=error_bars(gains), fmt="o", capsize=2)
    right.axvline(0.0, color="black", linewidth=0.8)
    left.invert_yaxis()
    left.set(xlabel="time (of the full method's)")
    right.set(xlabel="other views (dB over the full method's)", yticks=[], ylim=left.get_ylim())
    for axes in (left, right):
        axes.grid(alpha=0.3, axis="x")
        axes.set_axisbelow(True)
    figure.suptitle(f"{results.common['machine']}; views in brackets", fontsize=9)
    return figure


# Robustness


def robustness_chart(results: Results[RobustnessTrial]) -> "Figure":
    """Draw success rates: a panel per stressor, bars per level and preset."""
    rates = success_rates(results.rows)
    names = list(dict.fromkeys(name for name, _ in rates))
    columns = min(4, len(names))
    figure, panels = new_figure(columns, -(-len(names) // columns), 2.9)
    for axes in panels[len(names) :]:
        axes.remove()
    presets = list(dict.fromkeys(trial.preset for trial in results.rows))
    for axes, name in zip(panels, names, strict=False):
        by_level = {level: by_preset for (stressor, level), by_preset in rates.items() if stressor == name}
        _stressor_panel(axes, name, by_level, presets)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    measure = f"cameras within {SUCCESS_DEGREES:g}°; without an object: refused or doubted (%)"
    objects = len({trial.name for trial in results.rows})
    figure.suptitle(f"{measure}; {objects} objects; {results.common['machine']}", fontsize=9)
    return figure


def _stressor_panel(axes: "Axes", name: str, rates: dict[float, dict[str, Mean]], presets: list[str]) -> None:
    for number, preset in enumerate(presets):
        fractions = [by_preset.get(preset, (0, 0, 0)) for by_preset in rates.values()]
        percentages = [Mean(*(100 * bound for bound in fraction)) for fraction in fractions]
        width = 0.8 / len(presets)
        centres = [index + (number - (len(presets) - 1) / 2) * width for index in range(len(rates))]
        means = [percentage.mean for percentage in percentages]
        axes.bar(centres, means, width, label=preset, yerr=error_bars(percentages), error_kw={"linewidth": 0.8})
    axes.set_xticks(range(len(rates)), [f"{level:g}" for level in rates] if len(rates) > 1 else [""])
    middle = (len(rates) - 1) / 2
    half = max(3, len(rates)) / 2
    axes.set(xlim=(middle - half, middle + half), ylim=(0, 105), yticks=(0, 50, 100))
    axes.set_title(name, fontsize=10)
    axes.set_xlabel(STRESSORS[name].unit if name in STRESSORS else "", fontsize=8)
    axes.grid(alpha=0.3, axis="y")
    axes.set_axisbelow(True)
