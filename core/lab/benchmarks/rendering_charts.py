"""Charts of images and videos."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from core.detail.progressive import RenderSettings
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.drawing import draw_frontier, log_ticks, new_figure
from core.lab.benchmarks.rendering import RenderTiming, median_turns
from core.lab.benchmarks.videos import DEFAULT, VideoTiming

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def rendering_chart(results: Results[RenderTiming]) -> "Figure":
    """Draw PSNR against milliseconds, and milliseconds against image size."""
    timings = median_turns(results.rows)
    sizes = timings["sizes"]
    figure, (left, right) = new_figure(2)
    curves = [timings[name] for name in ("naive", "fast", "float32") if timings[name]]
    for points in curves:
        _timing_curve(left, points)
    draw_frontier(left, [(point.ms, point.psnr) for points in curves for point in points])
    default = RenderSettings()
    for name, samples, marker in (("preview", default.preview_samples, "kD"), ("final image", default.samples, "k*")):
        marked = [point for point in timings["fast"] if point.samples == samples]
        left.plot([p.ms for p in marked], [p.psnr for p in marked], marker, markersize=9, label=name, zorder=3)
    left.set(xscale="log", xlabel="ms per 128 x 128 image", ylabel="PSNR to the exact renderer (dB)")
    left.margins(y=0.1)
    right.plot([p.size for p in sizes], [p.ms for p in sizes], "o-", label=sizes[0].recipe)
    proportional = [sizes[0].ms * (p.size / sizes[0].size) ** 2 for p in sizes]
    right.plot([p.size for p in sizes], proportional, ":", color="grey", label="proportional to pixels")
    right.set(xscale="log", yscale="log", xlabel="width and height (px)", ylabel="ms per image")
    log_ticks(right.xaxis, [p.size for p in sizes])
    for axes in (left, right):
        log_ticks(axes.xaxis if axes is left else axes.yaxis)
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"{results.common['machine']}, {results.common['views']} views", fontsize=9)
    return figure


def videos_chart(results: Results[VideoTiming]) -> "Figure":
    """Draw PSNR against seconds of a turn, exact and baked; the star is the default."""
    figure, (axes,) = new_figure(1, width=6.5)
    turns = [row for row in results.rows if row.shown == "turn"]
    labels = {"exact": "every frame by the network, samples", "baked": "drawn from a baked copy, cells"}
    for recipe, label in labels.items():
        points = [row for row in turns if row.recipe == recipe]
        (line,) = axes.plot([point.seconds for point in points], [point.psnr for point in points], "o-", label=label)
        for point in points:
            axes.annotate(
                f"{point.setting:g}",
                (point.seconds, point.psnr),
                (5, -10),
                textcoords="offset points",
                fontsize=7,
                color=line.get_color(),
            )
    defaults = [row for row in turns if row.recipe == DEFAULT]
    seconds = [row.seconds for row in defaults]
    axes.plot(seconds, [row.psnr for row in defaults], "k*", markersize=12, label="default")
    common = results.common
    axes.set(xscale="log", xlabel=f"s of the processor for {common['frames']} frames of {common['size']} px")
    axes.set(ylabel="PSNR to the exact frame (dB)", title=f"{common['category']}, {common['objects']} objects")
    log_ticks(axes.xaxis)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.suptitle(common["machine"], fontsize=9)
    return figure


def _timing_curve(axes: "Axes", points: Sequence[RenderTiming]) -> None:
    """Draw PSNR against milliseconds; the numbers at the points are samples per ray."""
    (line,) = axes.plot([point.ms for point in points], [point.psnr for point in points], "o-", label=points[0].recipe)
    place: tuple[float, float] | None = None
    for point in points:
        # Labels of points that nearly coincide would overlap.
        if place is None or point.ms > 1.25 * place[0] or abs(point.psnr - place[1]) > 3:
            place = point.ms, point.psnr
            axes.annotate(
                str(point.samples), place, (5, -10), textcoords="offset points", fontsize=7, color=line.get_color()
            )
