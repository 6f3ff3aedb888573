"""Milliseconds against decibels: the naive renderer, the fast one, and the fast one without each of its parts.

PSNR is against the exact renderer with 256 samples a ray in float32. Times are the median of several rounds in which
all settings take turns, so that other load on the machine affects all of them: read them as ratios.
"""

import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import NamedTuple

import torch
from torch import Tensor

from core.benchmarks.held_out_views import evenly_spaced_objects
from core.benchmarks.machine import describe_machine
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.codes import Codes
from core.models.model import Model
from core.rendering import fast
from core.rendering.frame_budget import FrameBudget
from core.rendering.occupancy import Tolerances, tolerances
from core.rendering.progressive import RenderJob, RenderSettings, render_progressively
from core.rendering.reference import exact_rays, render_exact, render_rays

FULL = "full renderer"
REFERENCE_SAMPLES = 256
NAIVE_SAMPLES = (8, 16, 32, 64, 96)
FAST_SAMPLES = (32, 48, 60, 64, 96, 128, 192, 256)
SIZES = (64, 128, 256, 512)
INTERACTION_SIZES = (128, 256)
"""px"""
_COMPARED = 128
"""px, of the largest image that is compared with the reference pixel by pixel"""
_ROUNDS = 7
_INTERACTION_FRAMES = 40
_WARMUP_FRAMES = 12
"""frames before these, in which caches fill and the frame budget settles"""
_SETTLES = 3
"""times that the movement stops"""


@dataclass(frozen=True)
class Timing:
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
class Interaction:
    """How long images take while the camera or a code moves."""

    what: str
    """that moves: the camera ("orbit"), the texture or the shape"""
    size: int
    """px, of the final image"""
    p50: float
    """ms for the full image with all samples"""
    p95: float
    preview_p50: float
    """ms for the preview, as coarse as the frame budget makes it"""
    preview_p95: float
    preview_size: int
    """px, of the last preview"""
    settle_time: float
    """s from the end of the movement to the final image with 2 x 2 supersampling, mean over a few"""


@dataclass(frozen=True)
class RenderingResults:
    """All measurements of one run."""

    machine: str
    views: int
    naive: tuple[Timing, ...]
    fast: tuple[Timing, ...]
    sizes: tuple[Timing, ...]
    ablation: tuple[Timing, ...]
    interactions: tuple[Interaction, ...]


@dataclass(frozen=True, eq=False)
class _View:
    codes: Codes
    camera: Camera


def run(model: Model, views: int = 3) -> Iterator[str | RenderingResults]:
    """Yields what is being measured, and at the end the results."""
    seen = _views(model, views)
    yield "reference, 128 px"
    truth = [_exact(model, view, REFERENCE_SAMPLES) for view in seen]
    recipes = {("naive", samples): _naive(samples) for samples in NAIVE_SAMPLES}
    recipes |= {("fast", samples): _fast(samples) for samples in FAST_SAMPLES}
    timings = yield from _time_all(model, seen, truth, recipes)
    default = RenderSettings().samples
    ablations = {(name, default): _fast(default, cutoff) for name, cutoff in _ablations(default).items()}
    ablation = yield from _time_all(model, seen, truth, ablations)
    sizes = []
    for size in SIZES:
        yield f"reference, {size} px"
        some = [_View(view.codes, view.camera.resized(size, size)) for view in seen[:1]]
        exact = [_exact(model, view, REFERENCE_SAMPLES) for view in some]
        sizes += yield from _time_all(model, some, exact, {("fast", default): _fast(default)})
    interactions = []
    for size in INTERACTION_SIZES:
        for one in _interactions(model, size):
            yield f"{one.what}, {size} px: first image after {one.preview_p50:.0f} ms, the whole after {one.p50:.0f} ms"
            interactions.append(one)
    naive, fast = ([one for one in timings if one.recipe == name] for name in ("naive", "fast"))
    yield RenderingResults(
        describe_machine(model.device),
        len(seen),
        tuple(naive),
        tuple(fast),
        tuple(sizes),
        tuple(ablation),
        tuple(interactions),
    )


def _views(model: Model, count: int) -> list[_View]:
    """Objects evenly spaced over the model, from cameras evenly over the upper hemisphere."""
    some = evenly_spaced_objects(model, count)
    directions = [(2.4 * index + 0.9, math.asin((index + 0.7) / (len(some) + 0.9))) for index in range(len(some))]
    return [_View(codes, model.camera(*angles)) for (_, codes), angles in zip(some, directions, strict=True)]


class _Recipe(NamedTuple):
    render: Callable[[Model, _View], Tensor]
    warm: bool = True
    """It is rendered once before it is timed: the shape is known, and the caches hold nothing of other recipes."""


def _exact(model: Model, view: _View, samples: int) -> Tensor:
    """Every pixel of a small image, of a large one as many as fit into 128 x 128: the exact renderer is slow."""
    every = _every(view.camera)
    if every == 1:
        return render_exact(model, view.codes, view.camera, samples).colour.clamp(0, 1).cpu()
    biases, rows = model.field.biases(view.codes.shape, view.codes.texture), exact_rays(model, view.camera)
    with torch.no_grad():
        parts = [
            render_rays(model, rows[row, ::every], samples, *biases).colour for row in range(0, len(rows.near), every)
        ]
    return torch.stack(parts).clamp(0, 1).cpu()


def _every(camera: Camera) -> int:
    """Of how many rows and columns of an image one is compared with the reference."""
    return max(1, camera.height // _COMPARED)


def _naive(samples: int) -> _Recipe:
    return _Recipe(lambda model, view: _exact(model, view, samples), warm=False)


def _fast(samples: int, cutoff: Tolerances | None = None) -> _Recipe:
    """A new view of a known shape."""

    def render(model: Model, view: _View) -> Tensor:
        fast.clear_views()
        return fast.render(model, view.codes, view.camera, samples, cutoff=cutoff).colour.clamp(0, 1)

    return _Recipe(render)


def _time_all(
    model: Model, views: Sequence[_View], truth: Sequence[Tensor], recipes: dict[tuple[str, int], _Recipe]
) -> Generator[str, None, list[Timing]]:
    """Times all recipes on all views, taking turns; says after each turn how far it is, and at last what was found."""
    seconds: dict[tuple[str, int], list[list[float]]] = {key: [[] for _ in views] for key in recipes}
    found: dict[tuple[str, int], list[Tensor]] = {}
    for turn in range(_ROUNDS + 1):
        for key, recipe in recipes.items():
            # The slow ones vary little, and one round of them takes as long as all others together.
            if key[0] == "naive" and turn > 2:
                continue
            found[key] = []
            for view, times in zip(views, seconds[key], strict=True):
                image, spent = _timed(recipe, model, view)
                found[key].append(image)
                times += [spent] if turn else []
        yield f"{len(recipes)} settings, {views[0].camera.width} px: round {turn} of {_ROUNDS}"
    timings = []
    for (name, samples), images in found.items():
        ms = 1000 * sum(median(times) for times in seconds[name, samples]) / len(views)
        quality = [psnr(image, exact) for image, exact in zip(images, truth, strict=True)]
        off = max(float((image - exact).abs().max()) for image, exact in zip(images, truth, strict=True))
        size = views[0].camera.width
        timings.append(Timing(name, size, samples, ms, sum(quality) / len(quality), min(quality), off))
        yield f"{name}, {size} px, {samples} samples: {ms:.1f} ms, {timings[-1].psnr:.1f} dB"
    return timings


def _timed(recipe: _Recipe, model: Model, view: _View) -> tuple[Tensor, float]:
    if recipe.warm:
        fast.clear_cache()
        recipe.render(model, view)
    began = time.perf_counter()
    image = recipe.render(model, view).cpu()  # which waits for a graphics card to be done
    seconds = time.perf_counter() - began
    return image[:: _every(view.camera), :: _every(view.camera)], seconds


def _ablations(samples: int) -> dict[str, Tolerances]:
    """The fast renderer, and without each of its shortcuts."""
    cutoff = tolerances(samples)
    return {
        FULL: cutoff,
        "without early ray termination": cutoff._replace(termination=math.inf),
        "colouring all intervals": cutoff._replace(min_weight=-1.0),
    }


def _interactions(model: Model, size: int) -> Iterator[Interaction]:
    """The camera moves, then the texture, then the shape."""
    codes, camera = model.codes[0], model.camera(0.9, 0.4).resized(size, size)
    other = model.codes[len(model.codes.objects) // 2]

    def at(what: str, share: float, settings: RenderSettings) -> RenderJob:
        turned = replace(camera, azimuth=camera.azimuth + 2 * share)
        mixed = codes.mixed(other, share * (what == "shape"), share * (what == "texture"))
        return RenderJob(mixed, turned if what == "orbit" else camera, settings)

    for what in ("orbit", "texture", "shape"):
        shares = [
            (index + 1) / (_INTERACTION_FRAMES + _WARMUP_FRAMES)
            for index in range(_INTERACTION_FRAMES + _WARMUP_FRAMES)
        ]
        whole = [_seconds_until(model, at(what, share, RenderSettings(divisors=(1,))), last=True) for share in shares]
        fast.clear_cache()
        _seconds_until(model, at(what, 0.0, RenderSettings()), last=True)
        budget, previews = FrameBudget(), []
        for share in shares:
            settings = RenderSettings(divisors=budget.divisors(size), supersampling=2)
            previews.append(_seconds_until(model, at(what, share, settings), last=False))
            budget.observe(settings.divisors[0], previews[-1])
        ends = [
            at(what, 1.0 + index, RenderSettings(divisors=budget.divisors(size), supersampling=2))
            for index in range(_SETTLES)
        ]
        settle = sum(_seconds_until(model, job, last=True) for job in ends) / len(ends)
        preview_size = max(1, size // budget.divisor)
        yield Interaction(what, size, *_quantiles(whole), *_quantiles(previews), preview_size, settle)


def _seconds_until(model: Model, job: RenderJob, last: bool) -> float:
    """Seconds until a job's first image is there, or its last."""
    began = time.perf_counter()
    for frame in render_progressively(model, job):
        if frame and (frame.final or not last):
            break
    return time.perf_counter() - began


def _quantiles(values: Sequence[float]) -> tuple[float, float]:
    """ms: the median and the 95th percentile, without the warm-up."""
    ordered = sorted(1000 * value for value in values[_WARMUP_FRAMES:])
    return median(ordered), ordered[int(0.95 * (len(ordered) - 1))]
