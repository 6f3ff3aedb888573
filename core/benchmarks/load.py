"""How long one job takes beside other busy programs: with the threads that the program measures, and with one thread.

All settings take turns, so that what else the machine does falls on all of them, and medians over the turns are
compared with one thread beside nothing that is busy. The work is fixed: a fit neither stops early nor searches twice.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from statistics import median

import torch

from core.benchmarks.held_out_views import evenly_spaced_objects, render_on_white
from core.fitting.fit import PRESETS, FitJob, fit
from core.fitting.settings import ALL_COMPONENTS
from core.models.model import Model
from core.models.threads import with_measured_threads
from core.photos.photo import Photo
from core.rendering import fast
from core.rendering.progressive import RenderJob, RenderSettings, render_progressively

ONE, MEASURED = "one thread", "measured threads"
BUSY = (0, 1, 2, 4)
"""processes beside the job, each of which keeps a core busy"""
TARGET = 1.25
"""of the time of one thread on an idle machine, beside one busy process on two cores"""
_PRESETS = ("draft", "normal")
_SIZE, _IMAGES = 256, 24
"""px; and images of a turn around the object"""
_SPIN = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: sum(range(10000))"
"""ends with the program that started it, however that ends"""

Job = Callable[[], Iterable[object]]
"""Begins the work from the start; a stream."""
Key = tuple[str, str, int, int]


@dataclass(frozen=True)
class Timing:
    """One run of a job."""

    job: str
    threads: str
    busy: int
    """processes beside it"""
    turn: int
    seconds: float
    processor_seconds: float
    """of all threads together"""
    load: float | None
    """processes that wanted to run on the machine in the minute before the benchmark began; None where unknown"""

    @property
    def key(self) -> Key:
        """What tells a timing from all others."""
        return self.job, self.threads, self.busy, self.turn

    def __str__(self) -> str:
        return f"{self.job}, {self.threads}, {self.busy} busy, turn {self.turn}: {self.seconds:.2f} s"


@dataclass(frozen=True)
class LoadResults:
    """All timings of one run."""

    machine: str
    timings: tuple[Timing, ...]

    @property
    def jobs(self) -> list[str]:
        """In the order in which they were measured."""
        return list(dict.fromkeys(one.job for one in self.timings))

    @property
    def turns(self) -> int:
        """How often everything was measured, in part or whole."""
        return len({one.turn for one in self.timings})

    @property
    def busy_counts(self) -> list[int]:
        """How many processes were beside the jobs."""
        return sorted({one.busy for one in self.timings})

    def values(self, job: str, threads: str, busy: int, field: str = "seconds") -> list[float]:
        """Of all turns: ``seconds``, or ``processor_seconds``, which other load hardly changes unless threads wait for
        each other.
        """
        return [getattr(one, field) for one in self.timings if (one.job, one.threads, one.busy) == (job, threads, busy)]

    def ratios(self, job: str, threads: str, busy: int, field: str = "seconds") -> list[float]:
        """Of all turns, to the median of one thread beside nothing; none where that was not measured."""
        alone = self.values(job, ONE, 0, field)
        return [value / median(alone) for value in self.values(job, threads, busy, field)] if alone else []


def jobs_of(model: Model) -> dict[str, Job]:
    """What is measured, by name: blind fits by the quicker presets, and a turn around an object."""
    ((_, codes),) = evenly_spaced_objects(model, 1)
    colour, mask = render_on_white(model, codes, model.camera(0.9, 0.4))
    photo = Photo(colour, mask)
    whole = replace(ALL_COMPONENTS, early_stopping=False)

    def fit_by(preset: str) -> Job:
        settings = replace(PRESETS[preset], max_restarts=0)
        return lambda: fit(model, FitJob((photo,), settings, components=whole))

    def turn() -> Iterator[object]:
        fast.clear_views()
        for index in range(_IMAGES):
            camera = model.camera(6.28 * index / _IMAGES, 0.4).resized(_SIZE, _SIZE)
            yield from render_progressively(model, RenderJob(codes, camera, RenderSettings(divisors=(1,))))

    return {f"fit, {preset}": fit_by(preset) for preset in _PRESETS} | {f"{_IMAGES} images, {_SIZE} px": turn}


def run(
    jobs: Mapping[str, Job], turns: int, done: Collection[Key] = (), busy_counts: Iterable[int] = BUSY
) -> Iterator[Timing]:
    """Yields each timing as it is measured; those that are done are left out.

    Raises ``ValueError`` where torch has one thread only.
    """
    most, load = torch.get_num_threads(), _load_average()
    if most < 2:
        raise ValueError("torch has one thread here: there is nothing to choose (OMP_NUM_THREADS?)")
    warm = set[str]()
    for turn in range(turns):
        order = (ONE, MEASURED) if turn % 2 else (MEASURED, ONE)
        for busy in busy_counts:
            keys = [(job, threads, busy, turn) for job in jobs for threads in order]
            left = [key for key in keys if key not in done]
            for name in {key[0]: 0 for key in left if key[0] not in warm}:
                _timed(jobs[name], ONE, most)  # what it caches, and what oneDNN compiles
                warm.add(name)
            with busy_processes(busy if left else 0):
                for key in left:
                    yield Timing(*key, *_timed(jobs[key[0]], key[1], most), load)


def _timed(job: Job, threads: str, most: int) -> tuple[float, float]:
    """Seconds, and seconds of the processor; torch has as many threads afterwards as before."""
    torch.set_num_threads(1 if threads == ONE else most)
    try:
        began, used = time.perf_counter(), time.process_time()
        _consume(job() if threads == ONE else with_measured_threads(job()))
        return time.perf_counter() - began, time.process_time() - used
    finally:
        torch.set_num_threads(most)


def _consume(stream: Iterable[object]) -> None:
    for _ in stream:
        pass


@contextmanager
def busy_processes(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """So many processes that do nothing but keep a core busy, until the end of a ``with``."""
    processes = [subprocess.Popen([sys.executable, "-c", _SPIN]) for _ in range(count)]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def _load_average() -> float | None:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
