"""Estimated duration of a video, from timings of its steps measured on the object."""

import os
import tempfile
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from core.export.keyframes import View, turntable
from core.export.video import FORMATS, Coding, VideoSettings, coding_of
from core.export.video_frames import (
    STILL_STEPS,
    are_few,
    bake_views,
    count_objects,
    count_pixels,
    few_samples,
    key_views,
    over,
    supersampling,
)
from core.models.model import Model
from core.rendering.baked_field import MAX_STEPS
from core.rendering.baking import mixed
from core.rendering.offscreen import OffscreenRenderer
from core.rendering.progressive import Frame, RenderJob, RenderSettings, render_progressively

T = TypeVar("T")
_EXACT_SIZE, _DRAWN, _SMALL = 96, 384, 64  # px: the exact frame, and the rasterised frames


@dataclass(frozen=True)
class Pace:
    """Durations of the steps of a video, s."""

    exact: float  # a ray of an exact frame
    start: float = 0.0  # until the first frame: the comparison and the object baked for two cameras
    view: float = 0.0  # the same object baked for another camera
    frame: float = 0.0  # mixing two bakes, at any size
    ray: float = 0.0  # a rasterised ray
    baked: bool = False  # False if baking is impossible, so that all frames are rendered
    coding: Mapping[str, Coding] = field(default_factory=dict)  # of a written pixel, by the ending of the file's name

    def seconds(self, views: Sequence[View], suffix: str, exact: bool = False) -> float:
        """Return the expected duration of a video of these views, or of an image of one view, in s.

        Args:
            suffix: ending of the file's name; images are written in no time.
        """
        coding = self.coding.get(suffix, Coding(0.0, 0.0))
        pixels = count_pixels(views)
        parts = self._rendering(views, exact), pixels * coding.frame
        # Encoding runs in another thread, at the same time if there is another core.
        return (max(parts) if (os.cpu_count() or 1) > 1 else sum(parts)) + pixels * coding.end

    def _rendering(self, views: Sequence[View], exact: bool) -> float:
        few = are_few(views) and not exact
        if few or exact or not self.baked:
            samples = few_samples(views) if few else RenderSettings.samples
            return count_pixels(views) * self.exact * samples / RenderSettings.samples
        keys, objects = len(key_views(views)), count_objects(views)
        baking = objects * self.start + max(0, keys - objects - 1) * self.view
        finer = STILL_STEPS / MAX_STEPS if len(views) == 1 else 1.0
        rays = count_pixels(views) * supersampling(views[0].camera) ** 2
        return baking + len(views) * self.frame + rays * self.ray * finer


def measure_pace(model: Model, view: View) -> Iterator[Pace | None]:
    """Time each step of a video of this object, a second or two in total; yields None many times before."""
    camera = view.camera.resized(_EXACT_SIZE, _EXACT_SIZE)
    job = RenderJob(view.codes, camera, RenderSettings(divisors=(1,)))
    views = turntable(view.codes, view.camera, 72)[:9]
    baked, start = yield from _timed(bake_views(model, views))  # first, because exact rays need its preparations
    frames, exact = yield from _timed(_gather(model, job))
    ray, coding = exact / _EXACT_SIZE**2, _coding(frames[-1])
    if baked is None:
        yield Pace(ray, coding=coding)
        return
    first = yield from baked.at(0)
    second, another = yield from _timed(baked.at(len(views) - 1))
    with OffscreenRenderer((_DRAWN,) * 2) as large, OffscreenRenderer((_SMALL,) * 2) as small:
        for renderer in (large, small):  # the first one uploads and compiles
            renderer.draw(first, view.camera)
        began = time.perf_counter()
        small.draw(mixed(first, second, 0.5), view.camera)
        middle = time.perf_counter()
        large.draw(first, views[1].camera)
        drawn = time.perf_counter() - middle
    yield Pace(ray, start, another, middle - began, drawn / _DRAWN**2, True, coding)


def _gather(model: Model, job: RenderJob) -> Generator[None, None, list[Frame]]:
    found = list[Frame]()
    for frame in render_progressively(model, job):
        if frame:
            found.append(frame)
        yield
    return found


def _timed(stream: Generator[None, None, T]) -> Generator[None, None, tuple[T, float]]:
    """Return a stream's result and its own duration, without the time between its steps."""
    spent = 0.0
    while True:
        began = time.perf_counter()
        try:
            next(stream)
        except StopIteration as ended:
            return ended.value, spent + time.perf_counter() - began
        spent += time.perf_counter() - began
        yield


def _coding(frame: Frame) -> dict[str, Coding]:
    image = over(frame, (255, 255, 255)).repeat(4, 0).repeat(4, 1)
    with tempfile.TemporaryDirectory() as folder:
        return {suffix: coding_of(image, Path(folder) / f"frame{suffix}", VideoSettings()) for suffix in FORMATS}
