"""Tables and charts of the benchmarks, made from their CSV files, also later (:func:`redraw`).

To add a benchmark, add a module that measures its rows, a table in :mod:`core.lab.benchmarks.tables`, a function that
draws them, and a line to :data:`CHARTS`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from core.lab.benchmarks import candidates, fit_charts, fits, photos, robustness, tables
from core.lab.benchmarks.results import read_frame

_DPI = 110


class Chart(NamedTuple):
    """Functions that show the CSV file of a benchmark."""

    key: tuple[str, ...]  # columns that tell its rows apart
    table: Callable[[pd.DataFrame], str]
    figure: Callable[[pd.DataFrame], Figure] | None = None


def draw(folder: Path, name: str) -> str:
    """Write the table and chart of a CSV file beside it; return the table. Raise ``ValueError`` for another file."""
    chart = CHARTS[name]
    path = folder / f"{name}.csv"
    rows = read_frame(path, chart.key)
    table = chart.table(rows)
    path.with_suffix(".md").write_text(table)
    if chart.figure:
        chart.figure(rows).savefig(path.with_suffix(".png"), dpi=_DPI)
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


CHARTS = {
    "fit": Chart(fits.KEY, tables.fit_table, fit_charts.fit_chart),
    "robustness": Chart(robustness.KEY, tables.robustness_table, fit_charts.robustness_chart),
    "ablations": Chart(("summary.preset",), tables.ablations_table, fit_charts.ablations_chart),
    "candidates": Chart(candidates.KEY, tables.candidates_table),
    "photos": Chart(photos.KEY, tables.photos_table),
}  # by file name
