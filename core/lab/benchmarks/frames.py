"""Frames: milliseconds against the error of each renderer, for sizes of the image.

The standard is the exact render with many samples. Exact renders cost the same for every ray, so a random part of their
pixels is enough; the other renderers draw all pixels, and the same pixels are compared.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.geometry.camera import Camera
from core.gl.baking import bake
from core.gl.offscreen import OffscreenRenderer
from core.lab.benchmarks.held_out_views import HeldOutView, Trial, timed
from core.metrics import psnr
from core.models.model import Instance
from core.rendering import fast
from core.rendering.reference import exact_rays, render_rays

SIZES = (128, 384, 1024)  # px
EXACT = (32, 64, 128, 256)  # samples per ray
FAST = (32, 64, 192)  # intervals along the longest side of the box; the last is the program's
STANDARD = 512  # samples
_PIXELS = 2048  # of an image that are rendered exactly
_CHUNK_POINTS = 16_384  # at a time, so that activations stay in cache

Colours = Float[Tensor, "pixels 3"]


@dataclass(frozen=True)
class FrameTiming(Trial):
    """An image by one renderer."""

    size: int  # px, width and height
    renderer: str  # exact, fast or baked
    samples: int  # along a ray; cells along a side of a baked object
    n: int  # pixels that are compared
    milliseconds: float  # of the processor, for a whole image
    psnr: float  # dB, against the standard


def cases(quick: bool) -> tuple[str, ...]:
    """Return the names of the cases, sizes of the image."""
    return tuple(f"{size} px" for size in SIZES[: 2 if quick else None])


def measure(view: HeldOutView, case: str) -> tuple[FrameTiming, ...]:
    """Render a fitted object by all renderers at one size; baked ones need OpenGL."""
    size = int(case.removesuffix(" px"))
    camera = view.usual_camera.resized(size, size)
    generator = torch.Generator().manual_seed(view.seed)
    pixels = torch.randperm(size * size, generator=generator)[: min(_PIXELS, size * size)]
    standard = _exact(view.instance, camera, pixels, STANDARD)
    return tuple(
        FrameTiming(
            *(*view.key(case), size, renderer, samples, len(pixels)),
            milliseconds=1000 * seconds,
            psnr=psnr(colours, standard),
        )
        for renderer, samples, seconds, colours in _renders(view.instance, camera, pixels)
    )


def _renders(
    instance: Instance, camera: Camera, pixels: Int[Tensor, "pixels"]
) -> Iterator[tuple[str, int, float, Colours]]:
    """Yield name, samples, seconds and colours of each render."""
    scale = camera.width * camera.height / len(pixels)
    for samples in EXACT:
        seconds, colours = timed(partial(_exact, instance, camera, pixels, samples))
        yield "exact", samples, seconds * scale, colours
    for samples in FAST:
        fast.render(instance, camera, samples)  # compiles kernels and finds the occupied cells, once for an object
        fast.clear_views()
        seconds, rendered = timed(partial(fast.render, instance, camera, samples))
        yield "fast", samples, seconds, rendered.colour.reshape(-1, 3)[pixels].clamp(0, 1)
    try:
        renderer = OffscreenRenderer((camera.width, camera.height))
    except RuntimeError:
        return  # no OpenGL
    with renderer:
        for baked in (replace(baked, shadow=None) for baked in bake(instance) if baked):
            renderer.draw(baked, camera)  # uploads the texture
            seconds, image = timed(partial(renderer.draw, baked, camera))
            colours = torch.from_numpy(image.reshape(-1, 3).astype(np.float32))[pixels] / 255
            yield "baked", baked.cells, seconds, colours


def _exact(instance: Instance, camera: Camera, pixels: Int[Tensor, "pixels"], samples: int) -> Colours:
    """Return the colours of some pixels of an exact render."""
    model = instance.model
    rays = exact_rays(model, instance.local_camera(camera))
    with torch.no_grad():
        chunks = (rays[chunk // camera.width, chunk % camera.width] for chunk in pixels.split(_CHUNK_POINTS // samples))
        return torch.cat([render_rays(model, chunk, samples, *instance.biases).colour for chunk in chunks]).clamp(0, 1)
