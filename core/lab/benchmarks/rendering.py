"""Milliseconds against PSNR: the naive renderer, the fast one in each number format, and without each shortcut.

PSNR is against the exact renderer with 256 samples a ray in float32. Times of the network on a processor are processor
times of all threads, which other load changes little. Settings take turns, so that it affects all of them, and times
are medians over the turns: read them as ratios. A turn of a setting is a row, so a run can be resumed.
"""

import math
import time
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from statistics import median
from typing import NamedTuple

import torch
from torch import Tensor

from core.detail.progressive import RenderSettings
from core.export.keyframes import View
from core.geometry.camera import Camera
from core.gl.baked_field import BakedField, render_baked
from core.gl.baking import bake
from core.lab.benchmarks.held_out_views import evenly_spaced_objects
from core.metrics import psnr
from core.models.model import Instance, Model
from core.rendering import fast
from core.rendering.occupancy import Tolerances, tolerances
from core.rendering.reference import exact_rays, render_exact, render_rays
from core.runtime.precision import matmul_dtype, use_dtype

FULL = "full renderer"
REFERENCE_SAMPLES = 256
NAIVE_SAMPLES = (8, 16, 32, 64, 96)
FAST_SAMPLES = (32, 48, 64, 96, 128, 192, 256)
SIZES = (64, 128, 256, 512)
_SIZE = 128  # px, of most images
_COMPARED = 64  # px, of larger images that are compared with the reference pixel by pixel
TURNS, NAIVE_TURNS = 5, 2  # the naive renderer is slow and varies little
CURVES = ("naive", "fast", "float32", "baked", "sizes", "ablation")
"""fast: in the number format that this machine multiplies fastest; float32: the same in float32, if that differs"""


@dataclass(frozen=True)
class RenderTiming:
    """A setting of a recipe: one turn of it, or the median over turns."""

    curve: str  # one of CURVES
    recipe: str
    size: int  # px
    samples: int  # along a ray; of a baked field the cells along an axis
    turn: int
    ms: float  # per frame, mean over the views
    psnr: float  # dB, mean over the views
    worst_view: float  # dB
    worst_pixel: float  # largest difference of a channel, 0..1

    @property
    def key(self) -> tuple[str, str, int, int, int]:
        """The key of a turn."""
        return self.curve, self.recipe, self.size, self.samples, self.turn

    def __str__(self) -> str:
        return f"{self.recipe}, {self.size} px, {self.samples} samples: {self.ms:.1f} ms, {self.psnr:.1f} dB"


def median_turns(rows: Iterable[RenderTiming]) -> dict[str, tuple[RenderTiming, ...]]:
    """Return the median over turns of each setting, by curve."""
    turns: dict[Hashable, list[RenderTiming]] = {}
    for row in rows:
        turns.setdefault(row.key[:-1], []).append(row)
    medians = [replace(timings[0], turn=0, ms=median(timing.ms for timing in timings)) for timings in turns.values()]
    return {curve: tuple(timing for timing in medians if timing.curve == curve) for curve in CURVES}


class _Setting(NamedTuple):
    curve: str
    recipe: str
    size: int  # px
    samples: int
    views: Sequence[View]
    render: Callable[[View], Tensor]
    turns: int = TURNS
    warm: bool = True
    """rendered once before it is timed: the shape is known, and the caches hold nothing of other recipes"""


def measure_rendering(model: Model, views: int = 2, done: Collection[Hashable] = ()) -> Iterator[RenderTiming]:
    """Yield each row as it is measured, except those whose keys are done."""

    @cache
    def truth(view: View) -> Tensor:
        return _exact(view, REFERENCE_SAMPLES)

    settings = _settings(_views(model, views))
    for turn in range(TURNS):
        for setting in settings:
            key = (*setting[:4], turn)
            if turn < setting.turns and key not in done:
                yield _measure(setting, turn, truth)


def _settings(views: Sequence[View]) -> list[_Setting]:
    """Return all settings that take turns."""
    fastest = matmul_dtype("cpu")
    default = RenderSettings().samples
    name = f"fast, {str(fastest).removeprefix('torch.')}"
    settings = [
        _Setting("naive", "naive, float32", _SIZE, samples, views, _naive(samples), NAIVE_TURNS, warm=False)
        for samples in NAIVE_SAMPLES
    ]
    settings += [_Setting("fast", name, _SIZE, samples, views, _fast(samples)) for samples in FAST_SAMPLES]
    if fastest != torch.float32:
        settings += [
            _Setting("float32", "fast, float32", _SIZE, samples, views, _in_float32(_fast(samples)))
            for samples in FAST_SAMPLES
        ]
    settings += [
        _Setting("baked", "baked, marched by torch", _SIZE, 64 * 2**level, views, _baked(level)) for level in (0, 1)
    ]
    settings += [
        _Setting("ablation", recipe, _SIZE, default, views, _fast(default, cutoff))
        for recipe, cutoff in _ablations(default).items()
    ]
    for size in SIZES:
        resized = [view._replace(camera=view.camera.resized(size, size)) for view in views[:1]]
        settings.append(_Setting("sizes", name, size, default, resized, _fast(default)))
    return settings


def _measure(setting: _Setting, turn: int, truth: Callable[[View], Tensor]) -> RenderTiming:
    """Time a turn of a setting over all of its views."""
    seconds = []
    quality = []
    differences = []
    for view in setting.views:
        exact = truth(view)
        image, spent = _timed(setting, view)
        seconds.append(spent)
        quality.append(psnr(image, exact))
        differences.append(float((image - exact).abs().max()))
    ms = 1000 * sum(seconds) / len(seconds)
    mean = sum(quality) / len(quality)
    return RenderTiming(*setting[:4], turn, ms, mean, min(quality), max(differences))


def _views(model: Model, count: int) -> list[View]:
    """Return evenly spaced objects of the model, from cameras evenly over the upper hemisphere."""
    instances = evenly_spaced_objects(model, count)
    directions = [
        (2.4 * index + 0.9, math.asin((index + 0.7) / (len(instances) + 0.9))) for index in range(len(instances))
    ]
    return [View(instance, model.camera(*angles)) for instance, angles in zip(instances, directions, strict=True)]


def _exact(view: View, samples: int) -> Tensor:
    """Render all pixels of a small image, 64 x 64 of a large one: the exact renderer is slow."""
    stride = _pixel_stride(view.camera)
    if stride == 1:
        return render_exact(view.instance, view.camera, samples).colour.clamp(0, 1).cpu()
    model = view.instance.model
    biases = view.instance.biases
    rays = exact_rays(model, view.camera)
    with torch.no_grad():
        rows = [
            render_rays(model, rays[row, ::stride], samples, *biases).colour for row in range(0, len(rays.near), stride)
        ]
    return torch.stack(rows).clamp(0, 1).cpu()


def _pixel_stride(camera: Camera) -> int:
    """Return the stride of the pixels that are compared with the reference."""
    return camera.height // _COMPARED if camera.height > _SIZE else 1


def _naive(samples: int) -> Callable[[View], Tensor]:
    return lambda view: _exact(view, samples)


def _fast(samples: int, cutoff: Tolerances | None = None) -> Callable[[View], Tensor]:
    """Render a new view of a known shape."""

    def render(view: View) -> Tensor:
        fast.clear_views()
        return fast.render(view.instance, view.camera, samples, cutoff=cutoff).colour.clamp(0, 1)

    return render


def _in_float32(render: Callable[[View], Tensor]) -> Callable[[View], Tensor]:
    def forced(view: View) -> Tensor:
        with use_dtype(torch.float32):
            return render(view)

    return forced


def _baked(level: int) -> Callable[[View], Tensor]:
    """Draw a baked field as OpenGL does while an object is turned, by torch; baking is not timed."""

    @cache
    def baked(instance: Instance) -> BakedField:
        return [field for field in bake(instance) if field][level]

    return lambda view: render_baked(baked(view.instance), view.camera).colour.clamp(0, 1)


def _timed(setting: _Setting, view: View) -> tuple[Tensor, float]:
    if setting.warm:
        fast.clear_cache()
        setting.render(view)
    clock = time.perf_counter if view.instance.model.device.type == "cuda" else time.process_time
    began = clock()
    image = setting.render(view).cpu()  # waits for a graphics card to finish
    seconds = clock() - began
    stride = _pixel_stride(view.camera)
    return image[::stride, ::stride], seconds


def _ablations(samples: int) -> dict[str, Tolerances]:
    """Return the tolerances of the fast renderer, and without each of its shortcuts."""
    cutoff = tolerances(samples)
    return {
        FULL: cutoff,
        "without early ray termination": cutoff._replace(termination=math.inf),
        "colouring all intervals": cutoff._replace(min_weight=-1.0),
    }
