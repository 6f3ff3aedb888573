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


def _load_chart(found: LoadResults) -> "Figure":
    """A panel for each job; a dot for each turn, a line through the medians."""
    busy = found.busy_counts
    figure, panels = new_figure(len(found.jobs), width=4.2)
    for axes, job in zip(panels, found.jobs, strict=True):
        for threads in (ONE, MEASURED):
            ratios = {count: found.ratios(job, threads, count) for count in busy}
            ratios = {count: values for count, values in ratios.items() if values}
            (line,) = axes.plot(list(ratios), [median(values) for values in ratios.values()], "o-", label=threads)
            for count, values in ratios.items():
                axes.plot([count] * len(values), values, ".", color=line.get_color(), alpha=0.4)
        axes.plot(1, TARGET, "k_", markersize=16, markeredgewidth=2, label=f"{TARGET:g}, what is aimed at")
        axes.set(yscale="log", xticks=busy, xlabel="busy processes beside it", title=job)
        log_ticks(axes.yaxis)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("times one thread beside none")
    panels[0].legend()
    figure.suptitle(f"{found.machine}, {found.turns} turns", fontsize=9)
    return figure
