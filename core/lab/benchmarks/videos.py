"""Seconds against PSNR of videos and a large image: rendered by the network or drawn from baked fields.

One turn of 72 frames, a morph into another object and back, and one large image, without writing them. Times are
processor times of all threads, which other load changes little; of exact videos a few frames are timed. PSNR is that of
the same frames against 384 samples a ray.
"""

import time
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from statistics import mean, median
from typing import NamedTuple

from core.detail.progressive import RenderJob, RenderSettings, render_progressively
from core.export.framing import filling_frame
from core.export.keyframes import View, morph, turntable
from core.export.video_frames import CELLS, FEW_SAMPLES, Image, are_few, baked_frames
from core.lab.benchmarks.held_out_views import evenly_spaced_objects
from core.metrics import psnr
from core.models.model import Model

FRAMES = 72
COMPARED = 6, 30, 53  # compared frames
SIZE, IMAGE_SIZE = 512, 2160  # px, of a video and of an image
GRIDS = 128, 192, 256  # cells along an axis
SAMPLES = 48, 96, 192  # per ray; the last is the setting of exact videos
REFERENCE_SAMPLES = 384
DEFAULT = "default"


@dataclass(frozen=True)
class VideoTiming:
    """A way to render a video or an image, and its cost and accuracy, mean over objects."""

    shown: str  # turn, morph or image
    recipe: str  # exact, baked, or default: the choice of render_frames, choosing included
    setting: float  # samples per ray, or cells of the grid along an axis
    seconds: float  # of the processor, for all frames
    psnr: float  # dB
    worst: float  # dB, of a frame

    @property
    def key(self) -> Hashable:
        """The key of a row."""
        return self.shown, self.recipe, 0 if self.recipe == DEFAULT else self.setting

    def __str__(self) -> str:
        return f"{self.shown}, {self.recipe} {self.setting:g}: {self.seconds:.1f} s, {self.psnr:.1f} dB"


class _Video(NamedTuple):
    """The views of a video at their cameras' size, and the indices of those that are compared."""

    views: Sequence[View]
    compared: Sequence[int]


_Render = Callable[[_Video], tuple[float, float, list[Image]]]
"""Renders a video: its setting, s, and the compared frames."""


def measure_videos(model: Model, objects: int = 2, done: Collection[Hashable] = ()) -> Iterator[VideoTiming]:
    """Yield each row as it is measured, except those whose keys are done. Needs OpenGL."""
    camera = model.camera(0.9, 0.35).resized(SIZE, SIZE)
    turns = [filling_frame(turntable(instance, camera, FRAMES)) for instance in evenly_spaced_objects(model, objects)]
    videos = {
        "turn": [_Video(views, COMPARED) for views in turns],
        "morph": [_Video(views, COMPARED) for views in map(_morph, turns, turns[1:] + turns[:1])],
        "image": [_Video([_still(turn[0])], [0]) for turn in turns],
    }
    finest = ("exact", SAMPLES[-1], _exact(SAMPLES[-1]))
    default = (DEFAULT, 0, _default)
    turned: list[tuple[str, int, _Render]] = [("exact", samples, _exact(samples)) for samples in SAMPLES]
    turned += [("baked", cells, _baked(cells)) for cells in GRIDS]

    @cache
    def truth(kind: str, number: int) -> list[Image]:
        return _exact(REFERENCE_SAMPLES)(videos[kind][number])[2]

    for kind, recipes in (("turn", [*turned, default]), ("morph", [finest, default]), ("image", [finest, default])):
        for recipe, setting, render in recipes:
            if (kind, recipe, setting) in done:
                continue
            chosen = []
            seconds = []
            quality = []
            for number, video in enumerate(videos[kind]):
                choice, spent, frames = render(video)
                chosen.append(choice)
                seconds.append(spent)
                pairs = zip(frames, truth(kind, number), strict=True)
                quality += [psnr(frame / 255, exact / 255) for frame, exact in pairs]
            yield VideoTiming(kind, recipe, median(chosen), mean(seconds), mean(quality), min(quality))


def _still(view: View) -> View:
    return view._replace(camera=view.camera.resized(IMAGE_SIZE, IMAGE_SIZE))


def _morph(turn: Sequence[View], second: Sequence[View]) -> Sequence[View]:
    """Return as many views as a turn has, from the first object to the second and back."""
    return morph(turn[0].instance, second[0].instance, turn[0].camera, len(turn))


def _exact(samples: int) -> _Render:
    def render(video: _Video) -> tuple[float, float, list[Image]]:
        frames = []
        began = time.process_time()
        for index in video.compared:
            job = RenderJob(*video.views[index], RenderSettings(samples, (1,)))
            frames += [frame.image for frame in render_progressively(job) if frame]
        return samples, (time.process_time() - began) * len(video.views) / len(video.compared), frames

    return render


def _default(video: _Video) -> tuple[float, float, list[Image]]:
    render = _exact(FEW_SAMPLES) if are_few(video.views) else _baked(CELLS)
    return render(video)


def _baked(cells: int) -> _Render:
    """Draw from a grid of ``cells`` along an axis."""

    def render(video: _Video) -> tuple[float, float, list[Image]]:
        began = time.process_time()
        stream = baked_frames(video.views, (255, 255, 255), cells=cells)
        frames = [image for image in stream if image is not None]
        return cells, time.process_time() - began, [frames[index] for index in video.compared]

    return render
