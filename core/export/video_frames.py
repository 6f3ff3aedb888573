"""The frames of a video, or a single image: rasterised by OpenGL from baked objects, or rendered by the network.

An object is baked once, with its colours for a few of the video's cameras; other frames combine these colours. The
network renders few or small frames of an object, as in a morph, because baking would take longer. A view that comes
again, as on the way back of a swing, is rendered once.
"""

import zlib
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from core.detail.maps import detail_maps
from core.detail.progressive import Frame, RenderJob, RenderSettings, render_progressively
from core.export.films import View
from core.geometry.camera import Camera
from core.gl.background import Background, background_rows
from core.gl.baking import bake_views
from core.gl.offscreen import OffscreenRenderer

Image = UInt8[np.ndarray, "height width channels"]
_CELLS = 192  # of the grid along each axis of the scene's box
_RAYS = 512  # rays from top to bottom of a frame at least, by supersampling; beyond this no change is visible
FEW_PIXELS = 1_000_000  # of all frames of an object together: up to this many, rendering is faster than baking
_DRAWN = 0.15  # time of a pixel drawn by OpenGL on a processor, relative to one by the network at FEW_SAMPLES
FEW_SAMPLES = 96  # of a ray of few frames: half the time of exact rays, and 49 dB from them on average, 45 dB at worst


def render_frames(
    views: Sequence[View],
    background: Background | None,
    exact: bool = False,
    shadow: bool = False,
) -> Iterator[Image | None]:
    """Yield every frame, as large as its camera, with None many times in between.

    Frames are baked unless rendering by the network is faster or requested (``exact``).
    """
    frames = _distinct_frames(list(dict.fromkeys(views)), background, exact, shadow)
    repeats = Counter(views)
    compressed = dict[View, tuple[tuple[int, ...], bytes]]()  # shapes and pixels, compressed, of views that come again
    for view in views:
        if view in compressed:
            shape, pixels = compressed.pop(view)
            image = np.frombuffer(zlib.decompress(pixels), np.uint8).reshape(shape)
        else:
            image = yield from _next_image(frames)
        repeats[view] -= 1
        if repeats[view]:
            compressed[view] = image.shape, zlib.compress(image.tobytes(), 1)
        yield image


def _next_image(frames: Iterator[Image | None]) -> Generator[None, None, Image]:
    while (image := next(frames)) is None:
        yield None
    return image


def _distinct_frames(
    views: Sequence[View], background: Background | None, exact: bool, shadow: bool
) -> Iterator[Image | None]:
    samples = RenderSettings.samples if exact else _few_samples(views)
    for section in _sections(views):
        if exact or section.is_rendered:
            yield from exact_frames(section.views, background, shadow, samples)
        else:
            yield from baked_frames(section.views, background, shadow)


class _Section(NamedTuple):
    """Consecutive views of one model."""

    views: list[View]
    is_rendered: bool  # the network renders them faster than their objects are baked
    work: float  # pixels that the network renders with :data:`FEW_SAMPLES` in the same time


def _sections(views: Sequence[View]) -> Iterator[_Section]:
    for _, group in groupby(views, lambda view: view.instance.fingerprint):
        section = list(group)
        pixels = sum(view.camera.width * view.camera.height for view in section)
        objects = 1 + sum(first.instance != second.instance for first, second in pairwise(section))
        if pixels <= FEW_PIXELS * objects:
            yield _Section(section, True, pixels * _few_samples(views) / FEW_SAMPLES)
        else:
            yield _Section(section, False, FEW_PIXELS * objects + _DRAWN * pixels)


def _few_samples(views: Sequence[View]) -> int:
    """Return the samples of a ray for few frames; a single image is exact."""
    return RenderSettings.samples if len(views) == 1 else FEW_SAMPLES


def rendered_pixels(views: Sequence[View]) -> float:
    """Estimate the work of :func:`render_frames` as pixels that the network renders, with :data:`FEW_SAMPLES`."""
    return sum(section.work for section in _sections(list(dict.fromkeys(views))))


def exact_frames(
    views: Sequence[View],
    background: Background | None,
    shadow: bool = False,
    samples: int = RenderSettings.samples,
) -> Iterator[Image | None]:
    """Yield every frame rendered by the network with a ray for each pixel, with None many times in between."""
    settings = RenderSettings(samples, (1,))
    for view in views:
        for frame in render_progressively(RenderJob(*view, settings, shadow=shadow)):
            yield over(frame, background, view.camera) if frame else None


def baked_frames(views: Sequence[View], background: Background | None, shadow: bool = False) -> Iterator[Image | None]:
    """Yield every frame rasterised from baked objects, with None many times in between.

    Frames are exact if the machine has no OpenGL.
    """
    first = views[0].camera
    try:
        renderer = OffscreenRenderer((first.width, first.height), supersampling(first), background)
    except RuntimeError:
        yield from exact_frames(views, background, shadow)
        return
    with renderer:
        for instance, shots in groupby(views, lambda view: view.instance):
            cameras = [view.camera for view in shots]
            detail = yield from detail_maps(instance)
            baked = yield from bake_views(instance, cameras, _CELLS)
            for camera in cameras:
                field = replace(baked.seen_from(camera), detail=detail)
                yield renderer.draw(field if shadow else replace(field, shadow=None), camera)


def supersampling(camera: Camera) -> int:
    """Return the rays along each side of a pixel of a frame."""
    return min(4, -(-_RAYS // camera.height))


def over(
    frame: Frame, background: Background | None, camera: Camera | None = None
) -> UInt8[np.ndarray, "height width channels"]:
    """Composite a frame over a background as RGB; with None, return RGB and opacity, not premultiplied.

    Args:
        camera: the frame's camera; given, the frame's shadow is drawn on the ground.
    """
    opacity = frame.opacity.clip(0, 1)[..., None]
    premultiplied = frame.image - 255 * (1 - opacity)
    light = 1 - opacity  # fraction that the background contributes
    if camera and frame.shadow:
        light = light * (1 - frame.shadow.seen_by(camera).numpy()[..., None])
    if background is None:
        image = np.concatenate((premultiplied / np.maximum(1 - light, 1e-3), 255 * (1 - light)), -1)
    else:
        image = premultiplied + light * background_rows(background, len(light))
    return (image + 0.5).clip(0, 255).astype(np.uint8)
