"""Keeps and draws what :mod:`core.benchmarks.rendering` measured."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from core.benchmarks import tables
from core.benchmarks.csv_files import Row, append_record, read_csv, read_records
from core.benchmarks.drawing import draw_frontier, log_ticks, new_figure, write_chart
from core.benchmarks.rendering import Interaction, RenderingResults, Timing
from core.rendering.progressive import RenderSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def read_rows(folder: Path, about: Row) -> list[Timing | Interaction]:
    """What an earlier run into a folder measured. Raises ``ValueError`` where that was of something else."""
    return [
        *read_records(folder / "render.csv", Timing, about),
        *read_records(folder / "interaction.csv", Interaction, about),
    ]


def add_row(folder: Path, about: Row, row: Timing | Interaction) -> None:
    """A row more of ``render.csv`` or of ``interaction.csv``."""
    append_record(folder / ("render.csv" if isinstance(row, Timing) else "interaction.csv"), about, row)


def read_rendering(path: Path) -> RenderingResults:
    """Reads ``render.csv`` and, beside it, ``interaction.csv``. Raises ``ValueError`` where they are none."""
    first = read_csv(path)[0]
    rows = read_rows(path.parent, {})
    return RenderingResults.of(first["machine"], int(first["views"]), rows)


def draw_rendering(folder: Path) -> None:
    """``render.md`` and ``render.png``."""
    found = read_rendering(folder / "render.csv")
    write_chart(folder / "render", tables.rendering_table(found), _rendering_chart(found))


def _rendering_chart(found: RenderingResults) -> "Figure":
    figure, (left, right) = new_figure(2)
    curves = [points for points in (found.naive, found.fast, found.float32) if points]
    for points in curves:
        _timing_curve(left, points)
    draw_frontier(left, [(point.ms, point.psnr) for points in curves for point in points])
    default = RenderSettings()
    for name, samples, marker in (("preview", default.preview_samples, "kD"), ("final image", default.samples, "k*")):
        marked = [point for point in found.fast if point.samples == samples]
        left.plot([p.ms for p in marked], [p.psnr for p in marked], marker, markersize=9, label=name, zorder=3)
    left.set(xscale="log", xlabel="ms per 128 x 128 image", ylabel="PSNR to the exact renderer (dB)")
    left.margins(y=0.1)
    right.plot([p.size for p in found.sizes], [p.ms for p in found.sizes], "o-", label=found.sizes[0].recipe)
    first = found.sizes[0]
    proportional = [first.ms * (p.size / first.size) ** 2 for p in found.sizes]
    right.plot([p.size for p in found.sizes], proportional, ":", color="grey", label="proportional to pixels")
    right.set(xscale="log", yscale="log", xlabel="width and height (px)", ylabel="ms per image")
    log_ticks(right.xaxis, [p.size for p in found.sizes])
    for axes in (left, right):
        log_ticks(axes.xaxis if axes is left else axes.yaxis)
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"{found.machine}, {found.views} views", fontsize=9)
    return figure


def _timing_curve(axes: "Axes", points: Sequence[Timing]) -> None:
    """PSNR against milliseconds; the numbers at the points are samples a ray."""
    (line,) = axes.plot([point.ms for point in points], [point.psnr for point in points], "o-", label=points[0].recipe)
    place: tuple[float, float] | None = None
    for point in points:
        # Points that nearly coincide would write over one another.
        if place is None or point.ms > 1.25 * place[0] or abs(point.psnr - place[1]) > 3:
            place = point.ms, point.psnr
            axes.annotate(
                str(point.samples), place, (5, -10), textcoords="offset points", fontsize=7, color=line.get_color()
            )
