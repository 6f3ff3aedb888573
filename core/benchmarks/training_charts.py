"""Keeps and draws what the benchmarks that train models measured: model sizes, training shapes,
architectures and recipes."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core.benchmarks import tables
from core.benchmarks.architectures import Architecture, ArchitectureResults
from core.benchmarks.csv_files import from_row, read_csv, to_row, write_csv
from core.benchmarks.drawing import around, differences_figure, log_ticks, new_figure, write_chart
from core.benchmarks.model_sizes import ModelSize, ModelSizeResults
from core.benchmarks.recipe import RecipeScore
from core.benchmarks.scaling import ScalingPoint, ScalingResults
from core.evaluation.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COUNTS = ("objects", "tests", "steps")
"""of :class:`core.benchmarks.model_sizes.ModelSizeResults`"""


# Model sizes


def write_model_sizes(found: ModelSizeResults, folder: Path) -> None:
    """``model_sizes.csv``, ``model_sizes.md`` and ``model_sizes.png``."""
    counts = {name: str(getattr(found, name)) for name in _COUNTS}
    rows = [{"machine": found.machine} | counts | to_row(one) for one in found.sizes]
    write_csv(folder / "model_sizes.csv", rows)
    draw_model_sizes(folder)


def read_model_sizes(path: Path) -> ModelSizeResults:
    """Reads ``model_sizes.csv``. Raises ``ValueError`` where it is none."""
    rows = read_csv(path)
    objects, tests, steps = (int(rows[0][name]) for name in _COUNTS)
    return ModelSizeResults(rows[0]["machine"], objects, tests, steps, tuple(from_row(ModelSize, row) for row in rows))


def draw_model_sizes(folder: Path) -> None:
    """``model_sizes.md`` and ``model_sizes.png``."""
    found = read_model_sizes(folder / "model_sizes.csv")
    write_chart(folder / "model_sizes", tables.model_sizes_table(found), _model_sizes_chart(found))


def _model_sizes_chart(found: ModelSizeResults) -> "Figure":
    figure, (left, right) = new_figure(2)
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


# Training shapes


def write_scaling(found: ScalingResults, folder: Path) -> None:
    """``scaling.csv``, ``scaling.md`` and ``scaling.png``."""
    about = {"machine": found.machine, "category": found.category}
    about |= {"tests": str(found.tests), "steps": str(found.steps)}
    write_csv(folder / "scaling.csv", [about | to_row(point) for point in found.points])
    draw_scaling(folder)


def read_scaling(path: Path) -> ScalingResults:
    """Reads ``scaling.csv``. Raises ``ValueError`` where it is none."""
    rows = read_csv(path)
    first, points = rows[0], tuple(from_row(ScalingPoint, row) for row in rows)
    return ScalingResults(first["machine"], first["category"], int(first["tests"]), int(first["steps"]), points)


def draw_scaling(folder: Path) -> None:
    """``scaling.md`` and ``scaling.png``."""
    found = read_scaling(folder / "scaling.csv")
    write_chart(folder / "scaling", tables.scaling_table(found), _scaling_chart(found))


def _scaling_chart(found: ScalingResults) -> "Figure":
    figure, (left, middle, right) = new_figure(3, width=4.4)
    shapes = [point.shapes for point in found.points]
    left.plot(shapes, [point.new_views for point in found.points], "s--", label="training objects, new views")
    left.errorbar(shapes, **_with_intervals([point.held_out for point in found.points]), label="held-out objects")
    left.set(ylabel="dB, cameras known")
    left.legend(fontsize=8)
    middle.errorbar(shapes, **_with_intervals([point.gain for point in found.points]))
    middle.axhline(0.0, color="black", linewidth=0.8)
    middle.set(ylabel="held-out objects, gain (dB)")
    shares = [Mean(*(100 * share for share in point.found)) for point in found.points]
    right.errorbar(shapes, **_with_intervals(shares))
    right.set(ylabel="cameras found within 10 degrees (%)", ylim=(-2, 102))
    for axes in (left, middle, right):
        axes.set(xscale="log", xlabel="training shapes")
        log_ticks(axes.xaxis, shapes)
        axes.grid(alpha=0.3)
    about = f"{found.category}, {found.steps} steps each, {found.tests} held-out objects, 95 % intervals"
    figure.suptitle(f"{found.machine}, {about}", fontsize=9)
    return figure


def _with_intervals(means: Sequence[Mean]) -> dict[str, Any]:
    return {"y": [one.mean for one in means], "yerr": around(means), "fmt": "o-", "capsize": 2}


# Architectures


def write_architectures(found: ArchitectureResults, folder: Path) -> None:
    """``architectures.csv``, ``architectures.md`` and the picture, ``architectures.png``."""
    about = {"machine": found.machine, "category": found.category}
    about |= {"objects": str(found.objects), "steps": str(found.steps)}
    write_csv(folder / "architectures.csv", [about | to_row(one) for one in found.architectures])
    draw_architectures(folder)
    found.picture.save(folder / "architectures.png", optimize=True)


def draw_architectures(folder: Path) -> None:
    """``architectures.md``; the picture needs the models."""
    rows = read_csv(folder / "architectures.csv")
    about = f"{rows[0]['machine']}; {rows[0]['objects']} {rows[0]['category']}, {rows[0]['steps']} steps each"
    table = tables.architectures_table(about, [from_row(Architecture, row) for row in rows])
    (folder / "architectures.md").write_text(table)


# Recipe


def draw_recipe(folder: Path) -> None:
    """``recipe.md`` and ``recipe.png``."""
    rows = read_csv(folder / "recipe.csv")
    about = f"{rows[0]['machine']}; {rows[0]['objects']} {rows[0]['category']}, about {rows[0]['time']} s each"
    found = [from_row(RecipeScore, row) for row in rows]
    write_chart(folder / "recipe", tables.recipe_table(about, found), _recipe_chart(about, found))


def _recipe_chart(about: str, found: list[RecipeScore]) -> "Figure":
    default, *others = found
    better = [one.new_views - default.new_views for one in others]
    figure = differences_figure([one.name for one in others], better, 0.0, [one.gain(default) for one in others])
    left, right = figure.axes
    left.set(xlabel="training objects, new views (dB over the default)")
    right.set(xlabel="held-out objects (dB over the default)")
    figure.suptitle(about, fontsize=9)
    return figure
