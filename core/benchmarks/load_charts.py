"""Keeps and draws what :mod:`core.benchmarks.load` measured."""

from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from core.benchmarks import tables
from core.benchmarks.csv_files import read_csv, read_records
from core.benchmarks.drawing import log_ticks, new_figure, write_chart
from core.benchmarks.load import MEASURED, ONE, TARGET, LoadResults, Timing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read_load(path: Path) -> LoadResults:
    """Reads ``load.csv``. Raises ``ValueError`` where it is none."""
    return LoadResults(read_csv(path)[0]["machine"], read_records(path, Timing))


def draw_load(folder: Path) -> None:
    """``load.md`` and ``load.png``."""
    found = read_load(folder / "load.csv")
    write_chart(folder / "load", tables.load_table(found), _load_chart(found))


_ROWS = {"seconds": "time", "processor_seconds": "processor time"}


def _load_chart(found: LoadResults) -> "Figure":
    """A column for each job; a dot for each turn, a line through the medians."""
    figure, panels = new_figure(len(found.jobs), len(_ROWS), width=4.2)
    places = [(field, job) for field in _ROWS for job in found.jobs]
    for axes, (field, job) in zip(panels, places, strict=True):
        for threads in (ONE, MEASURED):
            ratios = {count: found.ratios(job, threads, count, field) for count in found.busy_counts}
            ratios = {count: values for count, values in ratios.items() if values}
            (line,) = axes.plot(list(ratios), [median(values) for values in ratios.values()], "o-", label=threads)
            for count, values in ratios.items():
                axes.plot([count] * len(values), values, ".", color=line.get_color(), alpha=0.4)
        if field == "seconds":
            axes.plot(1, TARGET, "k_", markersize=16, markeredgewidth=2, label=f"{TARGET:g}, what is aimed at")
        axes.set(yscale="log", xticks=found.busy_counts, xlabel="busy processes beside it", title=job)
        axes.set_ylim(min(0.5, axes.get_ylim()[0]), max(2.0, axes.get_ylim()[1]))
        axes.set_ylabel(f"{_ROWS[field]}, of one thread beside none")
        log_ticks(axes.yaxis)
        axes.grid(alpha=0.3)
    panels[0].legend()
    figure.suptitle(f"{found.machine}, {found.turns} turns", fontsize=9)
    return figure
