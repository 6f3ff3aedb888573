"""Seconds of films and of a picture against decibels: by the network with more and fewer samples, and drawn from finer
baked copies.

One turn of 72 frames, a morph into another object and back, and one large picture, without writing them. Times are
processor times of all threads, which other load changes little; of exact films a few frames are timed. PSNR is that of
the same frames against 384 samples a ray.
"""

import time
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from statistics import mean, median
from typing import NamedTuple

from core.detail.rendering import render_progressively
from core.export.framing import filling_frame
from core.export.keyframes import Keyframe, Timeline, View, turntable
from core.export.video_frames import FEW_SAMPLES, LEVELS, BakedViews, Image, are_few, bake_views
from core.lab.benchmarks.held_out_views import evenly_spaced_objects
from core.metrics import psnr
from core.models.model import Model
from core.rendering.offscreen import OffscreenRenderer
from core.rendering.progressive import RenderJob, RenderSettings
from core.streams import run_to_end

FRAMES = 72
COMPARED = 6, 30, 53  # frames that are compared: between two views that are baked, halfway or less
SIZE, PICTURE = 512, 2160  # px, of a film and of a picture
SAMPLES = 48, 96, 192  # of a ray; the last is what exact films have
REFERENCE_SAMPLES = 384
DEFAULT = "default"


@dataclass(frozen=True)
class Film:
    """A way to make the frames of a film, or a picture: what it takes and how exact it is, mean over objects."""

    shown: str  # turn, morph or picture
    recipe: str  # exact, baked, or default: as render_frames chooses, its choice timed
    setting: float  # samples of a ray, or cells of the grid along an axis
    seconds: float  # of the processor, for all frames
    psnr: float  # dB
    worst: float  # dB, of a frame

    @property
    def key(self) -> Hashable:
        """The key of a row."""
        return self.shown, self.recipe, 0 if self.recipe == DEFAULT else self.setting

    def __str__(self) -> str:
        return f"{self.shown}, {self.recipe} {self.setting:g}: {self.seconds:.1f} s, {self.psnr:.1f} dB"


class _Views(NamedTuple):
    """What a film shows, in the size of its cameras."""

    views: Sequence[View]
    compared: Sequence[int]


_Films = Callable[[Model, _Views], tuple[float, float, list[Image]]]
"""Makes a film: its setting, s, and the frames that are compared."""


def measure_films(model: Model, objects: int = 2, done: Collection[Hashable] = ()) -> Iterator[Film]:
    """Yields each row as it is measured; those whose keys are done are left out. Needs OpenGL."""
    some = [codes for _, codes in evenly_spaced_objects(model, objects)]
    camera = model.camera(0.9, 0.35).resized(SIZE, SIZE)
    turns = [filling_frame(model, turntable(codes, camera, FRAMES)) for codes in some]
    shown = {
        "turn": [_Views(views, COMPARED) for views in turns],
        "morph": [_Views(_morph(*pair), COMPARED) for pair in zip(turns, turns[1:] + turns[:1], strict=True)],
        "picture": [_Views([View(one[0].codes, one[0].camera.resized(PICTURE, PICTURE))], [0]) for one in turns],
    }
    finest, default = ("exact", SAMPLES[-1], _exact(SAMPLES[-1])), (DEFAULT, 0, _default)
    turned: list[tuple[str, int, _Films]] = [("exact", samples, _exact(samples)) for samples in SAMPLES]
    turned += [("baked", cells, _baked(cells)) for cells in LEVELS]

    @cache
    def truth(what: str, number: int) -> list[Image]:
        return _exact(REFERENCE_SAMPLES)(model, shown[what][number])[2]

    for what, recipes in (("turn", [*turned, default]), ("morph", [finest, default]), ("picture", [finest, default])):
        for recipe, setting, make in recipes:
            if (what, recipe, setting) in done:
                continue
            chosen, seconds, quality = [], [], []
            for number, views in enumerate(shown[what]):
                found, spent, frames = make(model, views)
                chosen.append(found)
                seconds.append(spent)
                quality += [psnr(one / 255, of / 255) for one, of in zip(frames, truth(what, number), strict=True)]
            yield Film(what, recipe, median(chosen), mean(seconds), mean(quality), min(quality))


def _morph(turn: Sequence[View], other: Sequence[View]) -> Sequence[View]:
    """As many views of a turn, from the first object to the second and back."""
    keys = Keyframe(0.0, turn[0]), Keyframe(0.5, View(other[0].codes, turn[0].camera))
    return Timeline(keys, 1.0, turns=1).views(len(turn))


def _exact(samples: int) -> _Films:
    def film(model: Model, shown: _Views) -> tuple[float, float, list[Image]]:
        frames, began = [], time.process_time()
        for index in shown.compared:
            job = RenderJob(*shown.views[index], RenderSettings(samples, (1,)))
            frames += [frame.image for frame in render_progressively(model, job) if frame]
        return samples, (time.process_time() - began) * len(shown.views) / len(shown.compared), frames

    return film


def _default(model: Model, shown: _Views) -> tuple[float, float, list[Image]]:
    few = are_few(shown.views, shown.views[0].camera.width)
    return (_exact(FEW_SAMPLES) if few else _baked(None))(model, shown)


def _baked(cells: int | None) -> _Films:
    """With a grid of so many cells, or the one that is fine enough."""

    def film(model: Model, shown: _Views) -> tuple[float, float, list[Image]]:
        began, views = time.process_time(), shown.views
        baked = BakedViews(model, views, cells) if cells else run_to_end(bake_views(model, views))
        if baked is None:
            raise ValueError(f"no grid is fine enough for {model.category}, or there is no OpenGL")
        with OffscreenRenderer(views[0].camera.width) as pictures:
            frames = [pictures.draw(run_to_end(baked.at(index)), view.camera) for index, view in enumerate(views)]
        return baked.cells, time.process_time() - began, [frames[index] for index in shown.compared]

    return film
