"""Charts of the benchmarks that fit: presets, stressors and ablations."""

from typing import TYPE_CHECKING

from core.lab.benchmarks.ablations import Ablation
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.detail_gains import DetailView, gain_by_object, others
from core.lab.benchmarks.drawing import around, draw_frontier, log_ticks, new_figure
from core.lab.benchmarks.fits import FitTrial, summarise_presets
from core.lab.benchmarks.robustness import SUCCESS_DEGREES, RobustnessTrial, success_rates
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.evaluation.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def fit_chart(found: Results[FitTrial]) -> "Figure":
    """Draw rotation error and fraction of right cameras over time, and PSNR of other views against time."""
    figure, (left, middle, right) = new_figure(3)
    summaries = summarise_presets(found.rows)
    for one in summaries:
        # A curve ends with the results at the time at which half of the fits have ended.
        end = one.seconds, one.rotation, one.within_5_degrees.mean
        curve = [point for point in one.curve if point[0] < one.seconds] + [end]
        left.plot([point[0] for point in curve], [max(point[1], 0.01) for point in curve], "o-", label=one.preset)
        middle.plot([point[0] for point in curve], [100 * point[2] for point in curve], "o-", label=one.preset)
        mean = one.held_out.mean
        right.errorbar(one.seconds, mean, around([one.held_out]), fmt="o", capsize=2)
        default = " (default)" if one.preset == "normal" else ""
        right.annotate(f"{one.preset}{default}", (one.seconds, mean), (6, -12), textcoords="offset points", fontsize=8)
    draw_frontier(right, [(one.seconds, one.held_out.mean) for one in summaries])
    left.set(xscale="log", yscale="log", xlabel="processor seconds", ylabel="rotation error (degrees, median)")
    middle.set(xscale="log", ylim=(-2, 102), xlabel="processor seconds", ylabel="cameras within 5 degrees (%)")
    right.set(xscale="log", xlabel="processor seconds (median)", ylabel="other views (dB, with 95 % intervals)")
    right.margins(x=0.25)
    for axes in (left, middle, right):
        log_ticks(axes.xaxis)
        axes.grid(alpha=0.3)
    log_ticks(left.yaxis)
    left.legend()  # in the middle it would hide points
    figure.suptitle(f"{found.about['machine']}, {summaries[0].fits} views", fontsize=9)
    return figure


def ablations_chart(found: Results[Ablation]) -> "Figure":
    """Draw time and accuracy of each ablation beside the full method."""
    names = [f"{part.summary.preset} ({part.summary.fits})" for part in found.rows]
    gains = [part.gain for part in found.rows]
    figure, (left, right) = new_figure(2)
    left.barh(names, [part.time for part in found.rows])
    left.axvline(1.0, color="black", linewidth=0.8)
    right.errorbar([one.mean for one in gains], names, xerr=around(gains), fmt="o", capsize=2)
    right.axvline(0.0, color="black", linewidth=0.8)
    left.invert_yaxis()
    left.set(xlabel="time (of the full method's)")
    right.set(xlabel="other views (dB over the full method's)", yticks=[], ylim=left.get_ylim())
    for axes in (left, right):
        axes.grid(alpha=0.3, axis="x")
        axes.set_axisbelow(True)
    figure.suptitle(f"{found.about['machine']}; views in brackets", fontsize=9)
    return figure


# Robustness


def robustness_chart(found: Results[RobustnessTrial]) -> "Figure":
    """Draw success rates: a panel per stressor, bars per level and preset."""
    rates = success_rates(found.rows)
    names = list(dict.fromkeys(name for name, _ in rates))
    columns = min(4, len(names))
    figure, panels = new_figure(columns, -(-len(names) // columns), 2.9)
    for axes in panels[len(names) :]:
        axes.remove()
    presets = list(dict.fromkeys(trial.preset for trial in found.rows))
    for axes, name in zip(panels, names, strict=False):
        _stressor_panel(axes, name, {level: one for (other, level), one in rates.items() if other == name}, presets)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    what = f"cameras within {SUCCESS_DEGREES:g}°; without an object: refused or doubted (%)"
    objects = len({trial.name for trial in found.rows})
    figure.suptitle(f"{what}; {objects} objects; {found.about['machine']}", fontsize=9)
    return figure


def _stressor_panel(axes: "Axes", name: str, rates: dict[float, dict[str, Mean]], presets: list[str]) -> None:
    for number, preset in enumerate(presets):
        shares = [Mean(*(100 * share for share in one.get(preset, (0, 0, 0)))) for one in rates.values()]
        width = 0.8 / len(presets)
        centres = [index + (number - (len(presets) - 1) / 2) * width for index in range(len(rates))]
        means = [one.mean for one in shares]
        axes.bar(centres, means, width, label=preset, yerr=around(shares), error_kw={"linewidth": 0.8})
    axes.set_xticks(range(len(rates)), [f"{level:g}" for level in rates] if len(rates) > 1 else [""])
    middle, half = (len(rates) - 1) / 2, max(3, len(rates)) / 2
    axes.set(xlim=(middle - half, middle + half), ylim=(0, 105), yticks=(0, 50, 100))
    axes.set_title(name, fontsize=10)
    axes.set_xlabel(STRESSORS[name].unit if name in STRESSORS else "", fontsize=8)
    axes.grid(alpha=0.3, axis="y")
    axes.set_axisbelow(True)


def photo_detail_chart(found: Results[DetailView]) -> "Figure":
    """Draw the gain of other views against their angle from the photo, a panel per category and camera."""
    places = sorted({(row.category, row.camera) for row in found.rows})
    figure, panels = new_figure(len(places), width=3.8)
    for axes, place in zip(panels, places, strict=True):
        rows = [row for row in others(found.rows) if (row.category, row.camera) == place]
        for number, renderer in enumerate(dict.fromkeys(row.renderer for row in rows)):
            own = [row for row in rows if row.renderer == renderer]
            for what, style in (("full", "o-"), ("direct", "s:")):
                bins = {middle: [row for row in own if abs(row.angle - middle) <= _BIN / 2] for middle in _MIDDLES}
                gains = {middle: gain_by_object(each, what) for middle, each in bins.items() if each}
                label = f"{renderer}{'' if what == 'full' else ', not mirrored'}"
                values = list(gains.values())
                axes.errorbar(
                    list(gains),
                    [one.mean for one in values],
                    around(values) if what == "full" else None,
                    fmt=style,
                    color=f"C{number}",
                    capsize=2,
                    label=label,
                )
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set(title=f"{place[0]}, camera {place[1]}", xlabel="degrees from the photo", ylabel="gain (dB)")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    figure.suptitle(found.about["machine"], fontsize=9)
    return figure


_BIN = 30.0  # degrees
_MIDDLES = tuple(_BIN * (number + 0.5) for number in range(6))
