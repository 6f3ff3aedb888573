"""Seconds against threads: whole jobs by the pool of threads, alone and beside busy programs."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from statistics import median

from core.detail.rendering import bake
from core.export.mesh import extract_mesh
from core.fitting.fit import PRESETS, FitJob, fit
from core.lab.benchmarks.gate import busy_processes
from core.lab.benchmarks.held_out_views import evenly_spaced_objects, render_on_white
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.view_bank import build_view_bank
from core.rendering import fast
from core.rendering.occupancy import shape_occupancy
from core.rendering.progressive import RenderSettings
from core.runtime.threads import VARIABLE
from core.streams import run_to_end

_BUSY = "import torch; torch.set_num_threads(2); a = torch.rand(1024, 1024)\nwhile os.getppid() == parent: a @ a"

_RUNS = 3


@dataclass(frozen=True)
class ThreadTiming:
    """A job with some number of threads."""

    step: str
    busy: int  # programs beside it, of two torch threads each
    threads: int
    seconds: float  # median of some runs
    processor: float  # s, of all threads

    def __str__(self) -> str:
        return f"{self.step}, {self.threads} threads, {self.busy} busy: {self.seconds:.2f} s"


def measure_threads(model: Model, counts: Sequence[int], loads: Sequence[int]) -> Iterator[ThreadTiming]:
    """Yield each row as it is measured: every step with so many threads, beside so many busy programs."""
    ((_, codes),) = evenly_spaced_objects(model, 1)
    camera = model.camera(0.9, 0.4)
    photo = Photo(*render_on_white(model, codes, camera))
    shape, bank = tuple(codes.shape.tolist()), run_to_end(build_view_bank(model))
    steps: dict[str, Callable[[], object]] = {
        "occupied cells": lambda: shape_occupancy(model, shape),
        "image of 512 px": lambda: fast.render(model, codes, camera.resized(512, 512), RenderSettings.samples),
        "baked copy": lambda: list(bake(model, codes)),
        "mesh": lambda: run_to_end(extract_mesh(model, codes, 192)),
        "draft fit": lambda: list(fit(model, FitJob((photo,), bank, PRESETS["draft"]))),
    }
    for run in steps.values():  # caches, and the kernels that oneDNN compiles
        run()
    for busy in loads:
        with busy_processes(busy, _BUSY):
            for step, run in steps.items():
                times: dict[int, list[tuple[float, float]]] = {count: [] for count in counts}
                for count in tuple(counts) * _RUNS:  # turn about, so that other load falls on all
                    os.environ[VARIABLE] = str(count)
                    fast.clear_cache()
                    began, before = time.perf_counter(), time.process_time()
                    run()
                    times[count].append((time.perf_counter() - began, time.process_time() - before))
                for count, found in times.items():
                    yield ThreadTiming(step, busy, count, *map(median, zip(*found, strict=True)))
