"""Output of every benchmark: CSV, a Markdown table and a chart. The extra ``bench`` brings matplotlib.

Tables and charts are made from the CSV, also later (:func:`redraw`). To add a benchmark, add a module that measures its
rows, a table in :mod:`core.lab.benchmarks.tables`, a function that draws them, and a line to :data:`CHARTS`.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from core.lab.benchmarks import fit_charts, tables
from core.lab.benchmarks.ablations import Ablation
from core.lab.benchmarks.candidates import Judgement
from core.lab.benchmarks.csv_files import Results, read_results, write_results
from core.lab.benchmarks.drawing import DPI
from core.lab.benchmarks.fits import FitTrial
from core.lab.benchmarks.photos import PhotoTrial
from core.lab.benchmarks.robustness import RobustnessTrial

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Chart(NamedTuple):
    """Functions that read and show the CSV file of a benchmark."""

    read: Callable[[Path], Any]
    table: Callable[[Any], str]
    figure: Callable[[Any], "Figure"] | None = None


def write(folder: Path, name: str, results: Results[Any]) -> str:
    """Write the CSV file of a benchmark, its table and its chart; return the table."""
    write_results(folder / f"{name}.csv", results)
    return draw(folder, name)


def draw(folder: Path, name: str) -> str:
    """Write the table and chart of a CSV file beside it; return the table. Raise ``ValueError`` for another file."""
    chart = CHARTS[name]
    path = folder / f"{name}.csv"
    results = chart.read(path)
    table = chart.table(results)
    path.with_suffix(".md").write_text(table)
    if chart.figure:
        chart.figure(results).savefig(path.with_suffix(".png"), dpi=DPI)
    return table


def redraw(folder: Path) -> list[Path]:
    """Make the tables and charts of all CSV files in a folder and its subfolders again; return these files.

    Raise ``ValueError`` if there are none.
    """
    files = [path for path in sorted(folder.rglob("*.csv")) if path.stem in CHARTS]
    if not files:
        raise ValueError(f"{folder}: no CSV file of a benchmark in it")
    for path in files:
        draw(path.parent, path.stem)
    return files


def _rows_of(kind: type) -> Callable[[Path], Results[Any]]:
    return partial(read_results, kind=kind)


CHARTS = {
    "fit": Chart(_rows_of(FitTrial), tables.fit_table, fit_charts.fit_chart),
    "robustness": Chart(_rows_of(RobustnessTrial), tables.robustness_table, fit_charts.robustness_chart),
    "ablations": Chart(_rows_of(Ablation), tables.ablations_table, fit_charts.ablations_chart),
    "candidates": Chart(_rows_of(Judgement), tables.candidates_table),
    "photos": Chart(_rows_of(PhotoTrial), tables.photos_table),
}  # by file name
