"""Writes what the benchmarks measured: CSV, a Markdown table and a chart. matplotlib comes with the extra ``bench``.

The CSV is the data: tables and charts can be made again from it (:func:`redraw`).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageDraw

from core.benchmarks import tables
from core.benchmarks.ablations import Ablation, AblationResults
from core.benchmarks.csv_files import append_record, from_row, read_csv, read_records, to_row, write_csv
from core.benchmarks.drawing import DPI, differences_figure, draw_frontier, log_ticks, new_figure, write_chart
from core.benchmarks.fits import FitResults
from core.benchmarks.fits import Trial as FitTrial
from core.benchmarks.rendering_charts import draw_rendering
from core.benchmarks.robustness import SUCCESS_DEGREES, Measured, RobustnessResults
from core.benchmarks.robustness import Trial as RobustnessTrial
from core.benchmarks.stressors import STRESSORS
from core.benchmarks.training_charts import draw_architectures, draw_model_sizes, draw_recipe, draw_scaling
from core.evaluation.statistics import Mean
from core.training.curve import CurvePoint, draw_curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FAILURE_SIDE, _MAX_FAILURES = 80, 60
"""px; and how many failures are shown"""


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
    write_chart(folder / "fit", tables.fit_table(found), _fit_chart(found))


def _fit_chart(found: FitResults) -> "Figure":
    figure, (left, middle, right) = new_figure(3)
    summaries = found.summaries
    for one in summaries:
        # A curve ends at the time at which half of the fits have ended, with what they have found.
        end = one.seconds, one.rotation, one.within_5_degrees.mean
        curve = [point for point in one.curve if point[0] < one.seconds] + [end]
        left.plot([point[0] for point in curve], [max(point[1], 0.01) for point in curve], "o-", label=one.preset)
        middle.plot([point[0] for point in curve], [100 * point[2] for point in curve], "o-", label=one.preset)
        mean, low, high = one.held_out
        right.errorbar(one.seconds, mean, [[mean - low], [high - mean]], fmt="o", capsize=2)
        default = " (default)" if one.preset == "normal" else ""
        right.annotate(f"{one.preset}{default}", (one.seconds, mean), (6, -12), textcoords="offset points", fontsize=8)
    draw_frontier(right, [(one.seconds, one.held_out.mean) for one in summaries])
    left.set(xscale="log", yscale="log", xlabel="seconds", ylabel="rotation error (degrees, median)")
    middle.set(xscale="log", ylim=(-2, 102), xlabel="seconds", ylabel="cameras within 5 degrees (%)")
    right.set(xscale="log", xlabel="seconds (median)", ylabel="other views (dB, with 95 % intervals)")
    right.margins(x=0.25)
    for axes in (left, middle, right):
        log_ticks(axes.xaxis)
        axes.grid(alpha=0.3)
    log_ticks(left.yaxis)
    left.legend()  # of all: in the middle it would hide points
    figure.suptitle(f"{found.machine}, {summaries[0].fits} views", fontsize=9)
    return figure


# Robustness


_FAILURES = "failures"
"""folder of the images of every failure, beside ``robustness.csv``"""


def read_robustness(folder: Path) -> RobustnessResults | None:
    """What ``robustness.csv`` of a folder holds; None where there is none."""
    path = folder / "robustness.csv"
    trials = read_records(path, RobustnessTrial)
    return RobustnessResults(read_csv(path)[0]["machine"], trials) if trials else None


def add_trial(folder: Path, machine: str, measured: Measured) -> None:
    """A row more of ``robustness.csv``, and the images of a failure: the corrupted one beside what was fitted."""
    trial, image, render = measured
    append_record(folder / "robustness.csv", {"machine": machine}, trial)
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
    write_chart(folder / "robustness", tables.robustness_table(found), _robustness_chart(found))
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
    figure, panels = new_figure(columns, -(-len(names) // columns), 2.9)
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
    write_chart(folder / "ablations", tables.ablations_table(found), _ablations_chart(found))


def _ablations_chart(found: AblationResults) -> "Figure":
    full, *others = found.ablations
    names, times = [part.summary.preset for part in others], [part.time for part in others]
    figure = differences_figure(names, times, 1.0, [part.gain for part in others])
    left, right = figure.axes
    left.set(xlabel="time (of the full method's)")
    right.set(xlabel="other views (dB over the full method's)")
    figure.suptitle(f"{found.machine}, {full.summary.fits} views", fontsize=9)
    return figure


# Training


def _draw_training(folder: Path) -> None:
    curves: dict[str, list[CurvePoint]] = {}
    for row in read_csv(folder / "training.csv"):
        point = CurvePoint(int(row["step"]), float(row["seconds"]), float(row["psnr"]))
        curves.setdefault(row["model"], []).append(point)
    draw_curves(curves).savefig(folder / "training.png", dpi=DPI)


_REDRAW: dict[str, Callable[[Path], None]] = {
    "render": draw_rendering,
    "fit": _draw_fits,
    "robustness": draw_robustness,
    "ablations": _draw_ablations,
    "model_sizes": draw_model_sizes,
    "scaling": draw_scaling,
    "architectures": draw_architectures,
    "recipe": draw_recipe,
    "training": _draw_training,
}
