"""Files and chart of :mod:`core.lab.benchmarks.rendering`, and the chart of videos."""

from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

from core.lab.benchmarks.csv_files import Results, Row, append_record, read_records, read_results
from core.lab.benchmarks.drawing import draw_frontier, log_ticks, new_figure
from core.lab.benchmarks.films import DEFAULT, Film
from core.lab.benchmarks.rendering import Interaction, RenderRow, RenderTiming, median_turns
from core.lab.benchmarks.threads import ThreadTiming
from core.rendering.progressive import RenderSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FILES: dict[type[RenderTiming] | type[Interaction], str] = {
    RenderTiming: "render.csv",
    Interaction: "interaction.csv",
}


def read_rows(folder: Path, about: Row) -> list[RenderRow]:
    """Return the rows of an earlier run into a folder. Raise ``ValueError`` if its ``about`` differs."""
    return [row for kind, name in _FILES.items() for row in read_records(folder / name, kind, about)]


def add_row(folder: Path, about: Row, row: RenderRow) -> None:
    """Append a row to ``render.csv`` or ``interaction.csv``."""
    append_record(folder / _FILES[type(row)], about, row)


def read_rendering(path: Path) -> Results[RenderRow]:
    """Read ``render.csv`` and, beside it, ``interaction.csv``. Raise ``ValueError`` if they do not parse."""
    return Results(read_results(path, RenderTiming).about, tuple(read_rows(path.parent, {})))


def rendering_chart(found: Results[RenderRow]) -> "Figure":
    """Draw PSNR against milliseconds, and milliseconds against image size."""
    timings = median_turns(found.rows)
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
    figure.suptitle(f"{found.about['machine']}, {found.about['views']} views", fontsize=9)
    return figure


def threads_chart(found: Results[ThreadTiming]) -> "Figure":
    """Seconds of each job against threads, a line for each load."""
    steps, loads = (list(dict.fromkeys(map(attrgetter(name), found.rows))) for name in ("step", "busy"))
    figure, plots = new_figure(len(steps), width=3.2)
    for axes, step in zip(plots, steps, strict=True):
        for busy in loads:
            some = [row for row in found.rows if (row.step, row.busy) == (step, busy)]
            axes.plot([one.threads for one in some], [one.seconds for one in some], "o-", label=f"{busy} busy programs")
        axes.set(title=step, xlabel="threads", ylabel="s", ylim=(0, None), xticks=sorted({one.threads for one in some}))
        axes.grid(alpha=0.3)
    plots[0].legend(loc="lower left")
    figure.suptitle(found.about["machine"], fontsize=9)
    return figure


def films_chart(found: Results[Film]) -> "Figure":
    """Draw PSNR against seconds of a turn, exact and baked; the star is the default."""
    figure, (axes,) = new_figure(1, width=6.5)
    turns = [row for row in found.rows if row.shown == "turn"]
    for recipe, what in (("exact", "every frame by the network, samples"), ("baked", "drawn from a baked copy, cells")):
        points = [row for row in turns if row.recipe == recipe]
        (line,) = axes.plot([one.seconds for one in points], [one.psnr for one in points], "o-", label=what)
        for one in points:
            axes.annotate(
                f"{one.setting:g}",
                (one.seconds, one.psnr),
                (5, -10),
                textcoords="offset points",
                fontsize=7,
                color=line.get_color(),
            )
    chosen = [row for row in turns if row.recipe == DEFAULT]
    axes.plot([one.seconds for one in chosen], [one.psnr for one in chosen], "k*", markersize=12, label="default")
    about = found.about
    axes.set(xscale="log", xlabel=f"s of the processor for {about['frames']} frames of {about['size']} px")
    axes.set(ylabel="PSNR to the exact frame (dB)", title=f"{about['category']}, {about['objects']} objects")
    log_ticks(axes.xaxis)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.suptitle(about["machine"], fontsize=9)
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
