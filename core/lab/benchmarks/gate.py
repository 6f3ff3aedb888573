"""A gate against slowdowns: times relative to a simple operation that is timed beside them.

Seconds depend on the machine, ratios hardly do, so a small baseline of ratios is committed. A ratio of more than twice
its baseline fails the gate: threads that wait for each other, a view bank that every process makes anew, a renderer or
a fit without its shortcuts. Fields run in float32, which every machine multiplies. Work in this process is timed by the
processor, commands by the clock, beside processes that keep all other cores busy.
"""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd
import torch

from core.detail.progressive import RenderSettings
from core.fitting.fit import PRESETS, FitJob
from core.fitting.paper import fit_as_set
from core.fitting.settings import FitSettings
from core.lab.benchmarks.held_out_views import render_on_white, timed
from core.lab.benchmarks.results import read_frame, write_frame
from core.models.library import sample_images
from core.models.model import Model
from core.photos.photo import Photo
from core.rendering import fast
from core.rendering.reference import render_exact
from core.runtime.precision import use_dtype

TOLERANCE = 2.0  # allowed multiple of the baseline's ratio
_EXACT, _NAIVE_STEPS = 64, 20  # px and samples of the exact render; steps of the paper's recipe
_ROOT = Path(__file__).resolve().parents[3]  # folder of the packages: another one may hold a core/ of its own
_IMPORT = (sys.executable, "-c", "import torch")
_SPIN = "import os; parent = os.getppid()\nwhile os.getppid() == parent: sum(range(10000))"
"""ends with the program that started it, even if that is killed"""


def measure_ratios(model: Model) -> Iterator[tuple[str, float]]:
    """Yield name and value of each ratio of two operations' times; takes under a minute on an idle machine."""
    instance = model.first
    camera = model.camera(0.9, 0.4)
    with use_dtype(torch.float32):
        exact = _second_time(lambda: render_exact(instance, camera.resized(_EXACT, _EXACT), _EXACT))
        rendered = _second_time(lambda: fast.render(instance, camera, RenderSettings().samples), fast.clear_views)
        photo = Photo(*render_on_white(instance, camera))
        naive = _second_time(lambda: _fit(model, photo, replace(PRESETS["paper"], steps=_NAIVE_STEPS)))
        fitted = _second_time(lambda: _fit(model, photo, replace(PRESETS["draft"], max_restarts=0)))
    yield "a render against an exact one", rendered / exact
    yield f"a draft fit against {_NAIVE_STEPS} naive steps", fitted / naive
    photo_path = str(sample_images(model.category)[0])
    words = (sys.executable, "-m", "core", "fit", photo_path, "--model", model.category, "--preset", "draft")
    with busy_processes(max(1, (os.cpu_count() or 1) - 1)):
        importing = _second_time(partial(subprocess.run, _IMPORT, check=True), clock=time.perf_counter)
        fit_process = partial(subprocess.run, words, cwd=_ROOT, capture_output=True, check=True)
        fitting = _second_time(fit_process, clock=time.perf_counter)
    yield "a draft fit's process against importing torch", fitting / importing


def compare(ratios: Mapping[str, float], baseline: Mapping[str, float]) -> list[str]:
    """Return a line for each ratio of the baseline that is missing or too large."""
    return [
        f"{name}: {usual:.3g}, now {f'{ratios[name]:.3g}' if name in ratios else 'missing'}"
        for name, usual in baseline.items()
        if not ratios.get(name, math.inf) <= TOLERANCE * usual
    ]


def write_baseline(path: Path, ratios: Mapping[str, float]) -> None:
    """Write ratios as a baseline."""
    write_frame(path, pd.DataFrame(ratios.items(), columns=["name", "value"]))


def read_baseline(path: Path) -> dict[str, float]:
    """Read the ratios of a baseline. Raise ``ValueError`` if the file has none."""
    if not path.is_file():
        raise ValueError(f"no baseline: {path}")
    frame = read_frame(path, ["name", "value"])
    return dict(zip(frame.name, frame.value, strict=True))


def _second_time(
    run: Callable[[], object], before: Callable[[], None] = lambda: None, clock: Callable[[], float] = time.process_time
) -> float:
    """Return the seconds of a second run; the first fills caches, also oneDNN's compiled kernels."""
    run()
    before()
    return timed(run, clock)[0]


def _fit(model: Model, photo: Photo, settings: FitSettings) -> None:
    for _ in fit_as_set(model, FitJob((photo,), settings)):
        pass


@contextmanager
def busy_processes(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Keep ``count`` cores busy with other processes until the end of a ``with``."""
    processes = [subprocess.Popen([sys.executable, "-c", _SPIN]) for _ in range(count)]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()
