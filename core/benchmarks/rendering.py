"""Milliseconds against decibels: the fast renderer, the naive recipe, and the fast one without each of its parts.

Everything is judged by the exact renderer with 256 samples a ray in float32. Times are the median of several rounds
in which all settings take turns, so that what else the machine does falls on all alike: read them as ratios.
"""

import math
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import median
from typing import NamedTuple

import torch
from torch import Tensor

from core.benchmarks.held_out_views import spread_objects
from core.benchmarks.patched import Change, changed
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models import precision
from core.models.codes import Codes
from core.models.model import Model
from core.rendering import fast as march
from core.rendering import folded_field as folded
from core.rendering import occupancy
from core.rendering.folded_field import AxisLookup
from core.rendering.frame_budget import FrameBudget
from core.rendering.progressive import RenderJob, RenderSettings, render_progressively
from core.rendering.reference import render_exact

REFERENCE_SAMPLES = 256
NAIVE_SAMPLES = (8, 16, 32, 64, 96)
FAST_SAMPLES = (32, 48, 60, 64, 96, 128, 192, 256)
SIZES = (64, 128, 256, 512)
DRAG_SIZES = (128, 256)
"""px"""
_ROUNDS = 7
_DRAGGED = 40
"""frames of a drag"""
_UNSETTLED = 12
"""frames before them, in which caches fill and the frame budget finds its size"""
_RESTS = 3


@dataclass(frozen=True)
class Point:
    """One setting of one recipe."""

    recipe: str
    size: int
    """px"""
    samples: int
    ms: float
    """per frame, mean over the views of the medians over rounds"""
    psnr: float
    """dB, mean over the views"""
    worst_view: float
    """dB"""
    worst_pixel: float
    """largest difference of a channel, 0..1"""


@dataclass(frozen=True)
class Drag:
    """How long pictures take while something moves."""

    what: str
    size: int
    """px, of the finished picture"""
    p50: float
    """ms for the whole picture with all samples"""
    p95: float
    first_p50: float
    """ms for the first picture, as coarse as the frame budget makes it"""
    first_p95: float
    first_size: int
    """px, of that picture in the end"""
    rest: float
    """s from the hand's rest to the finished picture, smoothed 2 x 2, mean over a few"""


@dataclass(frozen=True)
class Measured:
    """Everything that one run found."""

    machine: str
    views: int
    naive: tuple[Point, ...]
    fast: tuple[Point, ...]
    sizes: tuple[Point, ...]
    ablation: tuple[Point, ...]
    drags: tuple[Drag, ...]

    def told(self) -> dict:
        """As plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class _View:
    codes: Codes
    camera: Camera


def measured(model: Model, views: int = 3) -> Iterator[str | Measured]:
    """What is being measured now, and in the end all that was found."""
    seen = _views(model, views)
    yield "reference, 128 px"
    truth = [_exact(model, view, REFERENCE_SAMPLES) for view in seen]
    recipes = {("naive", samples): _naive(samples) for samples in NAIVE_SAMPLES}
    recipes |= {("fast", samples): _fast(samples) for samples in FAST_SAMPLES}
    yield "naive and fast, 128 px"
    points = _points(model, seen, truth, recipes)
    yield "without each part"
    default = RenderSettings().samples
    parts = {(name, default): _fast(default, _PARTS.get(name, ())) for name in ("nothing left out", *_PARTS)}
    ablation = _points(model, seen, truth, parts)
    sizes = []
    for size in SIZES:
        yield f"{size} px"
        some = [_View(view.codes, view.camera.resized(size, size)) for view in seen[:1]]
        exact = [_exact(model, view, REFERENCE_SAMPLES) for view in some]
        sizes += _points(model, some, exact, {("fast", default): _fast(default)})
    yield "drags"
    drags = tuple(drag for size in DRAG_SIZES for drag in _drags(model, size))
    naive, fast = ([point for point in points if point.recipe == name] for name in ("naive", "fast"))
    yield Measured(machine(model.device), len(seen), tuple(naive), tuple(fast), tuple(sizes), tuple(ablation), drags)


def _views(model: Model, count: int) -> list[_View]:
    """Objects spread over the model, from cameras spread over the upper half, none of which was trained from."""
    some = spread_objects(model, count)
    directions = [(2.4 * index + 0.9, math.asin((index + 0.7) / (len(some) + 0.9))) for index in range(len(some))]
    return [_View(codes, model.camera(*angles)) for (_, codes), angles in zip(some, directions, strict=True)]


class _Recipe(NamedTuple):
    draw: Callable[[Model, _View], Tensor]
    changes: tuple[Change, ...] = ()
    """that hold while it draws"""
    warm: bool = True
    """It is drawn once before it is timed: a shape has been seen before, and the recipe before has left the caches."""


def _exact(model: Model, view: _View, samples: int) -> Tensor:
    return render_exact(model, view.codes, view.camera, samples).colour.clamp(0, 1).cpu()


def _naive(samples: int) -> _Recipe:
    return _Recipe(lambda model, view: _exact(model, view, samples), warm=False)


def _fast(samples: int, changes: tuple[Change, ...] = ()) -> _Recipe:
    """A new view of a known shape: an orbit."""

    def draw(model: Model, view: _View) -> Tensor:
        march.clear_views()
        return march.render(model, view.codes, view.camera, samples).colour.clamp(0, 1)

    return _Recipe(draw, changes)


def _points(
    model: Model, views: Sequence[_View], truth: Sequence[Tensor], recipes: dict[tuple[str, int], _Recipe]
) -> list[Point]:
    """All recipes on all views, taking turns."""
    seconds: dict[tuple[str, int], list[list[float]]] = {key: [[] for _ in views] for key in recipes}
    found: dict[tuple[str, int], list[Tensor]] = {}
    for turn in range(_ROUNDS + 1):
        for key, recipe in recipes.items():
            # The slow ones vary little, and one round of them takes as long as all others together.
            if key[0] == "naive" and turn > 2:
                continue
            with changed(recipe.changes):
                pictures = []
                for index, view in enumerate(views):
                    picture, spent = _timed(recipe, model, view)
                    pictures.append(picture)
                    if turn:
                        seconds[key][index].append(spent)
            found[key] = pictures
    points = []
    for (name, samples), pictures in found.items():
        ms = 1000 * sum(median(times) for times in seconds[name, samples]) / len(views)
        quality = [psnr(picture, exact) for picture, exact in zip(pictures, truth, strict=True)]
        off = max(float((picture - exact).abs().max()) for picture, exact in zip(pictures, truth, strict=True))
        size = views[0].camera.width
        points.append(Point(name, size, samples, ms, sum(quality) / len(quality), min(quality), off))
    return points


def _timed(recipe: _Recipe, model: Model, view: _View) -> tuple[Tensor, float]:
    if recipe.warm:
        march.clear_cache()
        recipe.draw(model, view)
    began = time.perf_counter()
    picture = recipe.draw(model, view).cpu()  # which waits for a graphics card to be done
    return picture, time.perf_counter() - began


def _looking(**at: float) -> Change:
    """At more of a ray than is worth it."""
    return Change(march, "tolerances", lambda samples: occupancy.tolerances(samples)._replace(**at))


_PARTS: dict[str, tuple[Change, ...]] = {
    "without occupancy": (Change(occupancy, "_MIN_OPACITY", -1.0),),
    "without stopping spent rays": (_looking(termination=math.inf),),
    "colouring all intervals": (_looking(min_weight=-1.0),),
    "encoding instead of tables": (Change(AxisLookup, "__call__", AxisLookup.evaluate),),
    "in float32": (Change(folded, "matmul_dtype", lambda device: torch.float32),),
}


def _drags(model: Model, size: int) -> Iterator[Drag]:
    """While the camera, the texture or the shape moves by itself."""
    codes, camera = model.codes[0], model.camera(0.9, 0.4).resized(size, size)
    other = model.codes[len(model.codes.objects) // 2]

    def at(what: str, share: float, settings: RenderSettings) -> RenderJob:
        turned = replace(camera, azimuth=camera.azimuth + 2 * share)
        mixed = codes.mixed(other, share * (what == "shape"), share * (what == "texture"))
        return RenderJob(mixed, turned if what == "orbit" else camera, settings)

    for what in ("orbit", "texture", "shape"):
        shares = [(index + 1) / (_DRAGGED + _UNSETTLED) for index in range(_DRAGGED + _UNSETTLED)]
        whole = [_until(model, at(what, share, RenderSettings(divisors=(1,))), last=True) for share in shares]
        march.clear_cache()
        _until(model, at(what, 0.0, RenderSettings()), last=True)
        pace, first = FrameBudget(), []
        for share in shares:
            settings = RenderSettings(divisors=pace.divisors, supersampling=2)
            first.append(_until(model, at(what, share, settings), last=False))
            pace.observe(settings.divisors[0], first[-1])
        ends = [
            at(what, 1.0 + index, RenderSettings(divisors=pace.divisors, supersampling=2)) for index in range(_RESTS)
        ]
        rest = sum(_until(model, job, last=True) for job in ends) / len(ends)
        p50, p95, first_p50, first_p95 = *_quantiles(whole), *_quantiles(first)
        yield Drag(what, size, p50, p95, first_p50, first_p95, max(1, size // pace.divisor), rest)


def _until(model: Model, job: RenderJob, last: bool) -> float:
    """Seconds until a job's first picture is there, or its last."""
    began = time.perf_counter()
    for frame in render_progressively(model, job):
        if frame and (frame.final or not last):
            break
    return time.perf_counter() - began


def _quantiles(values: Sequence[float]) -> tuple[float, float]:
    """ms: the median and the 95th percentile, once things have settled."""
    ordered = sorted(1000 * value for value in values[_UNSETTLED:])
    return median(ordered), ordered[int(0.95 * (len(ordered) - 1))]


def machine(device: torch.device) -> str:
    """What the numbers were taken on."""
    dtype = str(precision.matmul_dtype(device.type)).removeprefix("torch.")
    card = f"{torch.cuda.get_device_name(device)}, " if device.type == "cuda" else ""
    return f"{card}{platform.machine()}, {torch.get_num_threads()} threads, {dtype}, torch {torch.__version__}"
