"""``bench all``: the tasks of all benchmarks, measured side by side, row by row into a CSV file for each benchmark.

A benchmark is a module with :func:`cases`, the names of its cases, and :func:`measure`, which returns the rows of one
case of one view. The first view of every object comes first, then the second: whenever the time is over, all objects
have been measured about as often. A later run goes on where one ended; rows by other code or another processor are
measured anew.
"""

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import product, takewhile
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from joblib import Parallel, delayed, parallel_config

from core.lab.benchmarks import disentanglement, exports, fits, frames, stability
from core.lab.benchmarks.held_out_views import Trial, held_out_view
from core.lab.benchmarks.results import append_rows, read_frame, write_frame
from core.lab.datasets.srn import evenly_spaced, index_objects
from core.models.library import shipped_models
from core.runtime.threads import thread_count, use_threads

BENCHMARKS: dict[str, ModuleType] = {
    "fits": fits,
    "stability": stability,
    "frames": frames,
    "exports": exports,
    "disentanglement": disentanglement,
}  # by the names of their CSV files
KEY = [field.name for field in fields(Trial)]  # columns that tell the rows' tasks apart
_ONCE = ("frames", "exports", "disentanglement")  # benchmarks that measure one view of an object


class Task(NamedTuple):
    """A case of a benchmark on a view of an object."""

    benchmark: str
    category: str
    name: str  # of the object
    number: int  # of the random order of its views
    case: str


class Plan(NamedTuple):
    """The objects and views to measure, and the time for it."""

    datasets: tuple[Path, ...]
    benchmarks: tuple[str, ...] = tuple(BENCHMARKS)
    objects: int | None = None  # of each category; None: all
    views: int = 1  # of each object
    quick: bool = False  # a few cases only
    minutes: float | None = None  # None: until all is done


def plan_tasks(plan: Plan) -> list[Task]:
    """Return all tasks: views, then objects, then benchmarks.

    Raises ``ValueError`` like :func:`index_objects`, and for a dataset of a category without a shipped model.
    """
    indexed = [index_objects([folder]) for folder in plan.datasets]
    for folder, (category, _) in zip(plan.datasets, indexed, strict=True):
        if category not in shipped_models():
            raise ValueError(f"{folder}: there is no model of its category {category!r}; its manifest.json names it")
    lists = [[(kind, entry.name) for entry in evenly_spaced(entries, plan.objects)] for kind, entries in indexed]
    rounds = max(map(len, lists))
    alternating = [names[index] for index in range(rounds) for names in lists if index < len(names)]
    return [
        Task(benchmark, category, name, number, case)
        for number, (category, name), benchmark in product(range(plan.views), alternating, plan.benchmarks)
        if number == 0 or benchmark not in _ONCE
        for case in BENCHMARKS[benchmark].cases(plan.quick)
    ]


def run(plan: Plan, out: Path, conditions: Mapping[str, str], report: Callable[[str], object]) -> bool:
    """Measure the missing tasks until the time is over; return whether all are done.

    Args:
        out: folder of the CSV files.
        conditions: columns that say where rows come from (:func:`core.lab.benchmarks.results.conditions`).
        report: gets a line for every row.
    """
    tasks = plan_tasks(plan)
    out.mkdir(parents=True, exist_ok=True)
    finished = {benchmark: _finished(out / f"{benchmark}.csv", conditions) for benchmark in plan.benchmarks}
    missing = [task for task in tasks if tuple(task[1:]) not in finished[task.benchmark]]
    deadline = math.inf if plan.minutes is None else time.monotonic() + 60 * plan.minutes
    in_time = takewhile(lambda _: time.monotonic() <= deadline, missing)
    done = 0
    for task, rows in _results(in_time, plan.datasets):
        done += 1
        if rows:
            append_rows(out / f"{task.benchmark}.csv", conditions, rows)
        report(f"{task.benchmark}: {task.category}, {task.name} {task.number}, {task.case}")
    return done == len(missing)


def _finished(path: Path, conditions: Mapping[str, str]) -> set[tuple]:
    """Return the keys of earlier rows by the same code and kind of processor; delete other rows."""
    if not path.exists():
        return set()
    frame = read_frame(path, (*KEY, "commit", "processor"))
    current = frame[(frame.commit == conditions["commit"]) & (frame.processor == conditions["processor"])]
    if current.empty:
        path.unlink()
    elif len(current) < len(frame):
        write_frame(path, current)
    return set(current[KEY].itertuples(index=False, name=None))


def _results(tasks: Iterator[Task], datasets: tuple[Path, ...]) -> Iterator[tuple[Task, Sequence[object]]]:
    """Yield the rows of each task as they are finished, from processes of one thread each, one for each core."""
    with parallel_config("loky", n_jobs=thread_count(), inner_max_num_threads=1):
        parallel = Parallel(return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1)
    yield from parallel(delayed(_measure)(task, datasets, os.getpid()) for task in tasks)


def _measure(task: Task, datasets: tuple[Path, ...], command: int) -> tuple[Task, Sequence[object]]:
    """Measure a task, in a process of one thread unless there is one process only."""
    if os.getpid() != command:
        use_threads(1)
    view = held_out_view(datasets, task.category, task.name, task.number)
    return task, BENCHMARKS[task.benchmark].measure(view, task.case)
