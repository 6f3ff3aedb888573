"""The chart of model sizes."""

from typing import TYPE_CHECKING

from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.drawing import new_figure
from core.lab.benchmarks.model_sizes import ModelSize

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
