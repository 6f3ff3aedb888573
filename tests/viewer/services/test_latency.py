"""How long a person waits for the view and for tiles while a fit and a film run, on one core."""

import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from core.api import camera_of
from core.detail.progressive import Frame, RenderJob, RenderSettings, render_progressively
from core.export.films import turntable
from core.export.video import write_video
from core.fitting.fit import FitJob, fit
from core.lab.benchmarks.held_out_views import DATASETS, held_out_view
from core.models.model import Instance
from core.runtime.threads import VARIABLE
from tests.viewer.machine import slowness
from viewer.services.jobs import FIT_WEIGHT, TILES_WEIGHT
from viewer.services.worker import Job, Worker

T = TypeVar("T")


def endless(start: Callable[[], Iterable[object]]) -> Iterator[None]:
    while True:
        for _ in start():
            yield None


def first_frame(worker: Worker, name: str, job: RenderJob, weight: float, urgent: bool = False) -> float:
    """Submit a render; return the seconds until its first frame."""
    done = threading.Event()

    def frames() -> Iterator[Frame | None]:
        for frame in render_progressively(job):
            yield frame
            if frame:
                done.set()

    began = time.perf_counter()
    worker.submit(Job(name, frames, lambda frame: None, urgent=urgent, weight=weight))
    assert done.wait(60.0)
    worker.deliver()
    return time.perf_counter() - began


def view(instance: Instance, number: int, size: int) -> RenderJob:
    camera = replace(camera_of(instance, size=size), azimuth=2.4 * number % (2 * math.pi))
    stages = (8, 4, 2) if size > 200 else (1,)
    return RenderJob(instance, camera, RenderSettings(64, stages), shadow=True)


@pytest.mark.slow  # a minute; prints its figures with -s
def test_view_and_tiles_do_not_wait_for_fit_and_film(worker: Worker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "1")
    chair = held_out_view(DATASETS, "chairs", "polyhaven_armchair_01", 0)
    model = chair.model
    photos = chair.photos(3, posed=False)
    film = turntable(model[5], camera_of(model[5], size=512), 24)
    worker.submit(Job("fit", lambda: endless(lambda: fit(model, FitJob(photos))), print, weight=FIT_WEIGHT))
    worker.submit(Job("film", lambda: endless(lambda: write_video(film, tmp_path / "film.mp4")), print))
    views = []
    tiles = []
    for number in range(60):
        time.sleep(0.5)
        views.append(first_frame(worker, "view", view(model[7], number, 384), FIT_WEIGHT, urgent=True))
        if number % 3 == 0:
            tiles.append(first_frame(worker, "tiles", view(model[20 + number], number, 96), TILES_WEIGHT))
    for name, seconds in (("view", views), ("tiles", tiles)):
        median, late = np.quantile(seconds, [0.5, 0.95])
        print(f"{name}: median {median:.3f} s, 95 % below {late:.3f} s, longest {max(seconds):.3f} s, n {len(seconds)}")
    assert np.median(views) < 0.3 * slowness()
    assert np.median(tiles) < 2.0 * slowness()
