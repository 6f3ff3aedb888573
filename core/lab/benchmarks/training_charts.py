"""Charts of the benchmarks that train models: model sizes and training shapes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.drawing import around, log_ticks, new_figure
from core.lab.benchmarks.model_sizes import ModelSize
from core.lab.benchmarks.scaling import ScalingPoint
from core.lab.evaluation.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def model_sizes_chart(found: Results[ModelSize]) -> "Figure":
    """Quality of training and of held-out objects against speed, a line per axis of the sweep."""
    figure, (left, right) = new_figure(2)
    baseline = found.rows[0]
    for axis in dict.fromkeys(one.axis for one in found.rows if one.value):
        swept = sorted((baseline, *(one for one in found.rows if one.axis == axis)), key=lambda one: one.bytes)
        marks = [one.parameters / 1000 for one in swept]
        for axes, psnr in ((left, [one.new_views for one in swept]), (right, [one.held_out.mean for one in swept])):
            (line,) = axes.plot([one.field_ms for one in swept], psnr, "-", alpha=0.6, label=axis.replace("_", " "))
            axes.scatter([one.field_ms for one in swept], psnr, marks, color=line.get_color())
    for one in found.rows:
        if one.axis == "default":
            left.plot(one.field_ms, one.new_views, "k*", markersize=14, label="default recipe", zorder=3)
            right.plot(one.field_ms, one.held_out.mean, "k*", markersize=14, label="default recipe", zorder=3)
    left.set(xlabel="ms for 100,000 samples", ylabel="training objects, new views (dB)")
    right.set(xlabel="ms for 100,000 samples", ylabel="held-out objects, one view fitted (dB)")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    about = "{machine}, {objects} objects, {steps} steps each; area of a point: parameters"
    figure.suptitle(about.format(**found.about), fontsize=9)
    return figure


def scaling_chart(found: Results[ScalingPoint]) -> "Figure":
    """Quality, gain and cameras found against the number of training shapes."""
    figure, (left, middle, right) = new_figure(3, width=4.4)
    shapes = [point.shapes for point in found.rows]
    left.plot(shapes, [point.new_views for point in found.rows], "s--", label="training objects, new views")
    left.errorbar(shapes, **_with_intervals([point.held_out for point in found.rows]), label="held-out objects")
    left.set(ylabel="dB, cameras known")
    left.legend(fontsize=8)
    middle.errorbar(shapes, **_with_intervals([point.gain for point in found.rows]))
    middle.axhline(0.0, color="black", linewidth=0.8)
    middle.set(ylabel="held-out objects, gain (dB)")
    shares = [Mean(*(100 * share for share in point.found)) for point in found.rows]
    right.errorbar(shapes, **_with_intervals(shares))
    right.set(ylabel="cameras found within 10 degrees (%)", ylim=(-2, 102))
    for axes in (left, middle, right):
        axes.set(xscale="log", xlabel="training shapes")
        log_ticks(axes.xaxis, shapes)
        axes.grid(alpha=0.3)
    about = "{machine}, {category}, {steps} steps each, {tests} held-out objects, 95 % intervals"
    figure.suptitle(about.format(**found.about), fontsize=9)
    return figure


def _with_intervals(means: Sequence[Mean]) -> dict[str, Any]:
    return {"y": [one.mean for one in means], "yerr": around(means), "fmt": "o-", "capsize": 2}
