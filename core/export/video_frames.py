"""The frames of a video, or a single image: rasterised by OpenGL from baked objects, or rendered by the network.

An object is baked for *key* views, and frames between two key views mix both bakes. One frame is compared with the
exact render first, and the object is baked finer until both agree. The network renders few or small frames of an
object, as in a morph, because baking would take longer.
"""

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np
import torch
from jaxtyping import UInt8

from core.detail.maps import detail_maps
from core.detail.rendering import render_progressively
from core.export.keyframes import View
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.codes import Codes
from core.models.model import Model
from core.models.open_models import OpenModels, model_of
from core.rendering.background import Background, background_rows
from core.rendering.baked_field import BakedField
from core.rendering.baking import Box, ObjectViews, bake_shape, box_of, mixed
from core.rendering.folded_field import FoldedField
from core.rendering.images import render_steps
from core.rendering.occupancy import shape_occupancy
from core.rendering.offscreen import OffscreenRenderer
from core.rendering.progressive import Frame, RenderJob, RenderSettings

Image = UInt8[np.ndarray, "height width channels"]
TARGET = 45.0  # dB between a baked frame and its exact render
LEVELS = (128, 192, 256, 320)  # cells of the grid along each axis of the scene's box, from coarse to fine
MAX_TURN = math.radians(20)
"""largest angle around the object between two key views, or an equally large change of position"""
_RAYS = 512  # rays from top to bottom of a frame at least, by supersampling; beyond this no change is visible
_PROBE = 128  # px, height of the frame compared with the exact render
FEW_PIXELS = 300_000  # of all frames of an object together: up to this many, rendering is faster than baking
FEW_SAMPLES = 96  # of a ray of few frames: half the time of exact rays, and 49 dB from them on average, 45 dB at worst
STILL_STEPS = 384  # of a ray through a baked object in a single image: a still eye sees banding with fewer


def render_frames(
    models: Model | OpenModels,
    views: Sequence[View],
    background: Background | None,
    exact: bool = False,
    shadow: bool = False,
) -> Iterator[Image | None]:
    """Yield every frame, as large as its camera, with None many times in between.

    Frames are baked unless rendering is faster or requested.

    Args:
        models: one for all views, or the open ones; views of another model begin another part.
        exact: render every frame with the network.
        shadow: include the object's shadow on the ground.
    """
    for _, part in groupby(views, lambda view: view.codes.model):
        shots = list(part)
        model = model_of(models, shots[0].codes)
        if exact:
            yield from exact_frames(model, shots, background, shadow)
        elif are_few(shots):
            yield from exact_frames(model, shots, background, shadow, few_samples(views))
        else:
            yield from baked_frames(model, shots, background, shadow)


def are_few(views: Sequence[View]) -> bool:
    """True if the network renders these frames faster than their objects are baked."""
    return count_pixels(views) <= FEW_PIXELS * count_objects(views)


def count_pixels(views: Sequence[View]) -> int:
    """Count the pixels of all frames."""
    return sum(view.camera.width * view.camera.height for view in views)


def few_samples(views: Sequence[View]) -> int:
    """Return the samples of a ray for few frames; a single image is exact."""
    return RenderSettings.samples if len(views) == 1 else FEW_SAMPLES


def count_objects(views: Sequence[View]) -> int:
    """Count changes of the object from view to view, plus one."""
    return 1 + sum(before.codes != after.codes for before, after in pairwise(views))


def exact_frames(
    model: Model,
    views: Sequence[View],
    background: Background | None,
    shadow: bool = False,
    samples: int = RenderSettings.samples,
) -> Iterator[Image | None]:
    """Yield every frame rendered by the network with a ray for each pixel, with None many times in between.

    Args:
        samples: of a ray.
    """
    settings = RenderSettings(samples, (1,))
    for view in views:
        for frame in render_progressively(model, RenderJob(*view, settings, shadow=shadow)):
            yield over(frame, background, view.camera) if frame else None


def baked_frames(
    model: Model, views: Sequence[View], background: Background | None, shadow: bool = False
) -> Iterator[Image | None]:
    """Yield every frame rasterised from bakes that are fine enough, with None many times in between.

    Frames are exact if the machine has no OpenGL, or if even the finest grid is too coarse.
    """
    baked = yield from bake_views(model, views)
    if baked is None:
        yield from exact_frames(model, views, background, shadow)
        return
    first = views[0].camera
    with OffscreenRenderer((first.width, first.height), supersampling(first), background) as renderer:
        for index, view in enumerate(views):
            field = yield from baked.at(index)
            detail = yield from detail_maps(model, view.codes)
            cast = shape_occupancy(model, tuple(view.codes.shape.tolist())).shadow if shadow else None
            yield renderer.draw(replace(field, detail=detail, shadow=cast), view.camera)


def draw_still(baked: BakedField, camera: Camera, shadow: bool) -> Image | None:
    """Rasterise one transparent image of a baked object; None if the machine has no OpenGL."""
    try:
        with OffscreenRenderer((camera.width, camera.height), supersampling(camera), None) as renderer:
            return renderer.draw(baked if shadow else replace(baked, shadow=None), camera)
    except RuntimeError:
        return None


def supersampling(camera: Camera) -> int:
    """Return the rays along each side of a pixel of a frame."""
    return min(4, -(-_RAYS // camera.height))


def bake_views(
    model: Model, views: Sequence[View], target: float = TARGET
) -> Generator[None, None, "BakedViews | None"]:
    """Bake the views on the coarsest grid that reaches ``target`` dB; None if no grid does, or without OpenGL."""
    index = _probe_frame(key_views(views))
    camera = views[index].camera
    camera = camera.resized(max(1, round(_PROBE * camera.width / camera.height)), _PROBE)
    try:
        renderer = OffscreenRenderer((camera.width, camera.height))
    except RuntimeError:
        return None
    with renderer:
        rendered = yield from render_steps(model, views[index].codes, camera, RenderSettings.samples)
        exact = rendered.colour.clamp(0, 1).cpu().numpy()
        for cells in LEVELS:
            baked = BakedViews(model, views, cells)
            field = yield from baked.at(index)
            if psnr(renderer.draw(field, camera) / 255, exact) >= target:
                return baked
    return None


def key_views(views: Sequence[View]) -> list[int]:
    """Return the indices of views to bake: the first, the last, and as few between as lie near enough to each other."""
    keys = [0]
    for index in range(2, len(views)):
        skipped = views[index - 1]  # may show another object, between two views of the same
        together = _near(views[keys[-1]], views[index]) and skipped.codes == views[index].codes
        if not together and keys[-1] != index - 1:
            keys.append(index - 1)
    return keys if keys[-1] == len(views) - 1 else [*keys, len(views) - 1]


class BakedViews:
    """Baked fields of a video's frames. Request frames in order: only the two current key views are kept."""

    def __init__(self, model: Model, views: Sequence[View], cells: int) -> None:
        self._model, self._views, self.cells = model, views, cells
        self._keys = key_views(views)
        self._fields: dict[int, BakedField] = {}
        self._object: tuple[Codes, ObjectViews] | None = None
        self._box: Box | None = None

    def at(self, index: int) -> Generator[None, None, BakedField]:
        """Bake or mix the field of a frame."""
        before = max(key for key in self._keys if key <= index)
        after = min(key for key in self._keys if key >= index)
        for key in (before, after):
            if key not in self._fields:
                self._fields[key] = yield from self._baked(self._views[key])
        self._fields = {key: self._fields[key] for key in (before, after)}
        share = (index - before) / max(1, after - before)
        field = mixed(self._fields[before], self._fields[after], share)
        return replace(field, steps=STILL_STEPS) if len(self._views) == 1 else field

    def _baked(self, view: View) -> Generator[None, None, BakedField]:
        if self._object is None or self._object[0] != view.codes:
            occupied = shape_occupancy(self._model, tuple(view.codes.shape.tolist())).cells
            folded = FoldedField(self._model, view.codes)
            shape = yield from bake_shape(self._model, folded, occupied, self.cells, self._video_box())
            self._object = view.codes, ObjectViews(self._model, folded, shape)
        return (yield from self._object[1].seen_from(view.camera))

    def _video_box(self) -> Box:
        """Return a box around all shapes of the video."""
        if self._box is None:
            shapes = {tuple(self._views[key].codes.shape.tolist()): None for key in self._keys}
            some = [shape_occupancy(self._model, shape).cells for shape in shapes]
            self._box = box_of(torch.stack(some).any(0), self.cells)
        return self._box


def _near(first: View, second: View) -> bool:
    """True if mixing two views shows the views between them well.

    Views of two objects do not mix: edges move, and a mixture of logits differs by 35 to 45 dB from the exact image
    between consecutive frames, by 28 to 39 dB between every second frame.
    """
    places = [_place(view.camera) for view in (first, second)]
    near = math.dist(*places) <= MAX_TURN * min(first.camera.distance, second.camera.distance)
    return near and first.codes == second.codes


def _place(camera: Camera) -> list[float]:
    return camera.pose()[:3, 3].tolist()


def _probe_frame(keys: Sequence[int]) -> int:
    """Return the frame halfway between the first two separate key views, where mixing is worst; else at a quarter.

    The video begins with the two views baked for it.
    """
    between = (before + (after - before) // 2 for before, after in pairwise(keys) if after - before > 1)
    return next(between, keys[(len(keys) - 1) // 4])


def over(
    frame: Frame, background: Background | None, camera: Camera | None = None
) -> UInt8[np.ndarray, "height width channels"]:
    """Composite a frame over a background as RGB; with None, return RGB and opacity, not premultiplied.

    Args:
        camera: the frame's camera; given, the frame's shadow is drawn on the ground.
    """
    opacity = frame.opacity.clip(0, 1)[..., None]
    own, left = frame.image - 255 * (1 - opacity), 1 - opacity
    if camera and frame.shadow:
        left = left * (1 - frame.shadow.seen_by(camera).numpy()[..., None])
    if background is None:
        image = np.concatenate((own / np.maximum(1 - left, 1e-3), 255 * (1 - left)), -1)
    else:
        image = own + left * background_rows(background, len(left))
    return (image + 0.5).clip(0, 255).astype(np.uint8)
