"""Writes what the benchmarks measured: CSV, a Markdown table and a chart. matplotlib comes with the extra ``bench``.

The CSV is the data: tables and charts can be made again from it (:func:`redraw`).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageDraw

from core.benchmarks import tables
from core.benchmarks.ablations import Ablation, AblationResults
from core.benchmarks.csv_files import append_csv, from_row, read_csv, to_row, write_csv
from core.benchmarks.fits import FitResults
from core.benchmarks.fits import Trial as FitTrial
from core.benchmarks.model_sizes import ModelSize, ModelSizeResults
from core.benchmarks.rendering import Interaction, RenderingResults, Timing
from core.benchmarks.robustness import SUCCESS_DEGREES, Measured, RobustnessResults
from core.benchmarks.robustness import Trial as RobustnessTrial
from core.benchmarks.stressors import STRESSORS
from core.evaluation.statistics import Mean
from core.rendering.progressive import RenderSettings
from core.training.curve import CurvePoint, draw_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_DPI = 110
_CURVES = ("naive", "fast", "sizes", "ablation")
"""of :class:`core.benchmarks.rendering.RenderingResults`, one after another in ``render.csv``"""

_FAILURE_SIDE, _MAX_FAILURES = 80, 60
"""px; and how many failures are shown"""
_COUNTS = ("objects", "tests", "steps")
"""of :class:`core.benchmarks.model_sizes.ModelSizeResults`"""


def prepare(folder: Path) -> None:
    """Checks, before hours are spent on measuring, that charts can be drawn and where they go.

    Raises ``ValueError`` where matplotlib is missing, ``OSError`` where there can be no such folder.
    """
    _figure(1)
    folder.mkdir(parents=True, exist_ok=True)


def redraw(folder: Path) -> list[Path]:
    """Makes the tables and charts of all CSV files in a folder, and in those in it, again; returns these files.

    Raises ``ValueError`` where there is none.
    """
    files = [path for path in sorted(folder.rglob("*.csv")) if path.stem in _REDRAW]
    if not files:
        raise ValueError(f"{folder}: no CSV file of a benchmark in it")
    for path in files:
        _REDRAW[path.stem](path.parent)
    return files


# Rendering


def write_rendering(found: RenderingResults, folder: Path) -> None:
    """``render.csv``, ``interaction.csv``, ``render.md`` and ``render.png``."""
    about = {"machine": found.machine, "views": str(found.views)}
    timings = [about | {"curve": curve} | to_row(one) for curve in _CURVES for one in getattr(found, curve)]
    write_csv(folder / "render.csv", timings)
    write_csv(folder / "interaction.csv", [about | to_row(one) for one in found.interactions])
    _draw_rendering(folder)


def read_rendering(path: Path) -> RenderingResults:
    """Reads ``render.csv`` and, beside it, ``interaction.csv``. Raises ``ValueError`` where they are none."""
    rows = read_csv(path)
    curves = {curve: tuple(from_row(Timing, row) for row in rows if row["curve"] == curve) for curve in _CURVES}
    interactions = tuple(from_row(Interaction, row) for row in read_csv(path.with_name("interaction.csv")))
    return RenderingResults(rows[0]["machine"], int(rows[0]["views"]), **curves, interactions=interactions)


def _draw_rendering(folder: Path) -> None:
    found = read_rendering(folder / "render.csv")
    _write(folder / "render", tables.rendering_table(found), _rendering_chart(found))


def _rendering_chart(found: RenderingResults) -> "Figure":
    figure, (left, right) = _figure(2)
    for name, points in (("naive, float32", found.naive), ("fast", found.fast)):
        _timing_curve(left, name, points)
    final = [point for point in found.fast if point.samples == RenderSettings().samples]
    left.plot([p.ms for p in final], [p.psnr for p in final], "k*", markersize=14, label="final image", zorder=3)
    left.set(xscale="log", xlabel="ms per 128 x 128 image", ylabel="PSNR to the exact renderer (dB)")
    left.margins(y=0.1)
    right.plot([p.size for p in found.sizes], [p.ms for p in found.sizes], "o-", label="fast")
    first = found.sizes[0]
    proportional = [first.ms * (p.size / first.size) ** 2 for p in found.sizes]
    right.plot([p.size for p in found.sizes], proportional, ":", color="grey", label="proportional to pixels")
    right.set(xscale="log", yscale="log", xlabel="width and height (px)", ylabel="ms per image")
    _log_ticks(right.xaxis, [p.size for p in found.sizes])
    for axes in (left, right):
        _log_ticks(axes.xaxis if axes is left else axes.yaxis)
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"{found.machine}, {found.views} views", fontsize=9)
    return figure


def _timing_curve(axes: "Axes", name: str, points: Sequence[Timing]) -> None:
    """PSNR against milliseconds; the numbers at the points are samples a ray."""
    (line,) = axes.plot([point.ms for point in points], [point.psnr for point in points], "o-", label=name)
    place: tuple[float, float] | None = None
    for point in points:
        # Points that nearly coincide would write over one another.
        if place is None or point.ms > 1.25 * place[0] or abs(point.psnr - place[1]) > 3:
            place = point.ms, point.psnr
            axes.annotate(
                str(point.samples), place, (5, -10), textcoords="offset points", fontsize=7, color=line.get_color()
            )


# Fits


def write_fits(found: FitResults, folder: Path) -> None:
    """``fit.csv``, ``fit.md`` and ``fit.png``."""
    write_csv(folder / "fit.csv", [{"machine": found.machine} | to_row(trial) for trial in found.trials])
    _draw_fits(folder)


def read_fits(path: Path) -> FitResults:
    """Reads ``fit.csv``. Raises ``ValueError`` where it is none."""
    rows = read_csv(path)
    return FitResults(rows[0]["machine"], tuple(from_row(FitTrial, row) for row in rows))


def _draw_fits(folder: Path) -> None:
    found = read_fits(folder / "fit.csv")
    _write(folder / "fit", tables.fit_table(found), _fit_chart(found))


def _fit_chart(found: FitResults) -> "Figure":
    figure, (left, right) = _figure(2)
    summaries = found.summaries
    for one in summaries:
        # A curve ends at the time at which half of the fits have ended, with what they have found.
        end = one.seconds, one.rotation, one.within_5_degrees.mean
        curve = [point for point in one.curve if point[0] < one.seconds] + [end]
        left.plot([point[0] for point in curve], [max(point[1], 0.01) for point in curve], "o-", label=one.preset)
        right.plot([point[0] for point in curve], [100 * point[2] for point in curve], "o-", label=one.preset)
    left.set(xscale="log", yscale="log", xlabel="seconds", ylabel="rotation error (degrees, median)")
    right.set(xscale="log", ylim=(-2, 102), xlabel="seconds", ylabel="cameras within 5 degrees (%)")
    for axes in (left, right):
        _log_ticks(axes.xaxis)
        axes.grid(alpha=0.3)
    _log_ticks(left.yaxis)
    left.legend()  # of both: on the right it would hide points
    figure.suptitle(f"{found.machine}, {summaries[0].fits} views", fontsize=9)
    return figure


# Robustness


_FAILURES = "failures"
"""folder of the images of every failure, beside ``robustness.csv``"""


def read_robustness(folder: Path) -> RobustnessResults | None:
    """What ``robustness.csv`` of a folder holds; None where there is none."""
    path = folder / "robustness.csv"
    if not path.exists():
        return None
    rows = read_csv(path)
    return RobustnessResults(rows[0]["machine"], tuple(from_row(RobustnessTrial, row) for row in rows))


def add_trial(folder: Path, machine: str, measured: Measured) -> None:
    """A row more of ``robustness.csv``, and the images of a failure: the corrupted one beside what was fitted."""
    trial, image, render = measured
    append_csv(folder / "robustness.csv", {"machine": machine} | to_row(trial))
    if image is None:
        return
    sheet = Image.new("RGB", (2 * _FAILURE_SIDE + 2, _FAILURE_SIDE), "white")
    for index, pixels in enumerate((image, render)):
        if pixels is not None:
            one = Image.fromarray(pixels).resize((_FAILURE_SIDE, _FAILURE_SIDE))
            sheet.paste(one, (index * (_FAILURE_SIDE + 2), 0))
    (folder / _FAILURES).mkdir(exist_ok=True)
    sheet.save(_failure_path(folder, trial))


def draw_robustness(folder: Path) -> None:
    """``robustness.md``, ``.png``, and ``failures.png`` with failures of the normal preset."""
    found = read_robustness(folder)
    if found is None:
        raise ValueError(f"{folder}: no robustness.csv in it")
    _write(folder / "robustness", tables.robustness_table(found), _robustness_chart(found))
    failed = [trial for trial in found.trials if not trial.success and trial.preset == "normal"]
    shown = [trial for trial in failed if _failure_path(folder, trial).exists()]
    if shown:
        _failures_sheet(folder, shown).save(folder / "failures.png", optimize=True)


def _failure_path(folder: Path, trial: RobustnessTrial) -> Path:
    name = f"{trial.stressor} {trial.level:g} {trial.preset} {trial.name}.png"
    return folder / _FAILURES / name.replace(" ", "_")


def _robustness_chart(found: RobustnessResults) -> "Figure":
    rates = found.success_rates()
    names = list(dict.fromkeys(name for name, _ in rates))
    columns = min(4, len(names))
    figure, panels = _figure(columns, -(-len(names) // columns), 2.9)
    for axes in panels[len(names) :]:
        axes.remove()
    presets = list(dict.fromkeys(trial.preset for trial in found.trials))
    for axes, name in zip(panels, names, strict=False):
        levels = [level for stressor, level in rates if stressor == name]
        for number, preset in enumerate(presets):
            shares = [rates[name, level].get(preset, Mean(0, 0, 0)) for level in levels]
            width = 0.8 / len(presets)
            centres = [index + (number - (len(presets) - 1) / 2) * width for index in range(len(levels))]
            errors = [[100 * (one.mean - one.low) for one in shares], [100 * (one.high - one.mean) for one in shares]]
            means = [100 * one.mean for one in shares]
            axes.bar(centres, means, width, label=preset, yerr=errors, error_kw={"linewidth": 0.8})
        axes.set_xticks(range(len(levels)), [f"{level:g}" for level in levels] if len(levels) > 1 else [""])
        middle, half = (len(levels) - 1) / 2, max(3, len(levels)) / 2
        axes.set(xlim=(middle - half, middle + half), ylim=(0, 105), yticks=(0, 50, 100))
        axes.set_title(name, fontsize=10)
        axes.set_xlabel(_unit(name), fontsize=8)
        axes.grid(alpha=0.3, axis="y")
        axes.set_axisbelow(True)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    what = f"cameras within {SUCCESS_DEGREES:g}°; without an object: refused or doubted (%)"
    figure.suptitle(f"{what}; {found.objects} objects; {found.machine}", fontsize=9)
    return figure


def _unit(stressor: str) -> str:
    return STRESSORS[stressor].unit if stressor in STRESSORS else ""


def _failures_sheet(folder: Path, failed: Sequence[RobustnessTrial]) -> Image.Image:
    """Failures, evenly over all: the image, a render of what was fitted, and what they are called."""
    columns, line = 6, 13
    stride = -(-len(failed) // _MAX_FAILURES)
    failed = failed[::stride]
    width, height = 2 * _FAILURE_SIDE + 12, _FAILURE_SIDE + 2 * line + 6
    sheet = Image.new("RGB", (columns * width, -(-len(failed) // columns) * height), "white")
    draw = ImageDraw.Draw(sheet)
    for number, trial in enumerate(failed):
        left, top = number % columns * width + 4, number // columns * height + 2
        with Image.open(_failure_path(folder, trial)) as pair:
            sheet.paste(pair, (left, top))
        draw.rectangle((left - 1, top - 1, left + 2 * _FAILURE_SIDE + 2, top + _FAILURE_SIDE), outline="lightgrey")
        draw.text((left, top + _FAILURE_SIDE + 2), f"{trial.stressor} {trial.level:g}", "black")
        confidence = "" if trial.confidence is None else f", confidence {trial.confidence:.2f}"
        draw.text((left, top + _FAILURE_SIDE + 2 + line), f"{trial.outcome}"[:18] + confidence, "dimgrey")
    return sheet


# Ablations


def write_ablations(found: AblationResults, folder: Path) -> None:
    """``ablations.csv``, ``ablations.md`` and ``ablations.png``."""
    write_csv(folder / "ablations.csv", [{"machine": found.machine} | to_row(one) for one in found.ablations])
    _draw_ablations(folder)


def read_ablations(path: Path) -> AblationResults:
    """Reads ``ablations.csv``. Raises ``ValueError`` where it is none."""
    rows = read_csv(path)
    return AblationResults(rows[0]["machine"], tuple(from_row(Ablation, row) for row in rows))


def _draw_ablations(folder: Path) -> None:
    found = read_ablations(folder / "ablations.csv")
    _write(folder / "ablations", tables.ablations_table(found), _ablations_chart(found))


def _ablations_chart(found: AblationResults) -> "Figure":
    figure, (left, right) = _figure(2)
    full, *others = found.ablations
    names, gains = [part.summary.preset for part in others], [part.gain for part in others]
    left.barh(names, [part.time for part in others])
    left.axvline(1.0, color="black", linewidth=0.8)
    left.set(xlabel="time (of the full method's)")
    around = [[one.mean - one.low for one in gains], [one.high - one.mean for one in gains]]
    right.errorbar([one.mean for one in gains], names, xerr=around, fmt="o", capsize=2)
    right.axvline(0.0, color="black", linewidth=0.8)
    left.invert_yaxis()
    right.set(xlabel="other views (dB over the full method's)", yticks=[], ylim=left.get_ylim())
    for axes in (left, right):
        axes.grid(alpha=0.3, axis="x")
        axes.set_axisbelow(True)
    figure.suptitle(f"{found.machine}, {full.summary.fits} views", fontsize=9)
    return figure


# Model sizes


def write_model_sizes(found: ModelSizeResults, folder: Path) -> None:
    """``model_sizes.csv``, ``model_sizes.md`` and ``model_sizes.png``."""
    counts = {name: str(getattr(found, name)) for name in _COUNTS}
    rows = [{"machine": found.machine} | counts | to_row(one) for one in found.sizes]
    write_csv(folder / "model_sizes.csv", rows)
    _draw_model_sizes(folder)


def read_model_sizes(path: Path) -> ModelSizeResults:
    """Reads ``model_sizes.csv``. Raises ``ValueError`` where it is none."""
    rows = read_csv(path)
    objects, tests, steps = (int(rows[0][name]) for name in _COUNTS)
    return ModelSizeResults(rows[0]["machine"], objects, tests, steps, tuple(from_row(ModelSize, row) for row in rows))


def _draw_model_sizes(folder: Path) -> None:
    found = read_model_sizes(folder / "model_sizes.csv")
    _write(folder / "model_sizes", tables.model_sizes_table(found), _model_sizes_chart(found))


def _model_sizes_chart(found: ModelSizeResults) -> "Figure":
    figure, (left, right) = _figure(2)
    baseline = found.sizes[0]
    for axis in dict.fromkeys(one.axis for one in found.sizes if one.value):
        swept = sorted((baseline, *(one for one in found.sizes if one.axis == axis)), key=lambda one: one.bytes)
        marks = [one.parameters / 1000 for one in swept]
        for axes, psnr in ((left, [one.new_views for one in swept]), (right, [one.held_out.mean for one in swept])):
            (line,) = axes.plot([one.field_ms for one in swept], psnr, "-", alpha=0.6, label=axis.replace("_", " "))
            axes.scatter([one.field_ms for one in swept], psnr, marks, color=line.get_color())
    for one in found.sizes:
        if one.axis == "default":
            left.plot(one.field_ms, one.new_views, "k*", markersize=14, label="default recipe", zorder=3)
            right.plot(one.field_ms, one.held_out.mean, "k*", markersize=14, label="default recipe", zorder=3)
    left.set(xlabel="ms for 100,000 samples", ylabel="training objects, new views (dB)")
    right.set(xlabel="ms for 100,000 samples", ylabel="held-out objects, one view fitted (dB)")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    about = f"{found.objects} objects, {found.steps} steps each; area of a point: parameters"
    figure.suptitle(f"{found.machine}, {about}", fontsize=9)
    return figure


# Training


def _draw_training(folder: Path) -> None:
    curves: dict[str, list[CurvePoint]] = {}
    for row in read_csv(folder / "training.csv"):
        point = CurvePoint(int(row["step"]), float(row["seconds"]), float(row["psnr"]))
        curves.setdefault(row["model"], []).append(point)
    draw_curves(curves).savefig(folder / "training.png", dpi=_DPI)


_REDRAW: dict[str, Callable[[Path], None]] = {
    "render": _draw_rendering,
    "fit": _draw_fits,
    "robustness": draw_robustness,
    "ablations": _draw_ablations,
    "model_sizes": _draw_model_sizes,
    "training": _draw_training,
}


def _write(path: Path, table: str, figure: "Figure") -> None:
    path.with_suffix(".md").write_text(table)
    figure.savefig(path.with_suffix(".png"), dpi=_DPI)


def _figure(columns: int, rows: int = 1, width: float = 5.2) -> tuple["Figure", Sequence["Axes"]]:
    """A figure and its axes, row after row; ``width`` of each in inches."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("charts need matplotlib: pip install -e '.[bench]'") from None
    figure = Figure(figsize=(width * columns, 0.8 * width * rows), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _log_ticks(axis: "Axis", places: Sequence[float] | None = None) -> None:
    """Plain numbers at 1, 2 and 5 of every decade, or at ``places``; no minor labels to overlap them."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

    axis.set_major_locator(FixedLocator(places) if places else LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
