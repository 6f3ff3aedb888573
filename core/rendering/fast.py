"""The fast renderer: only occupied cells are evaluated, front to back, and only what is seen is coloured.

It works in two passes, as the field does. What a shape shows from a camera (:class:`Visible`) does not depend on the
texture and is kept: a new texture is a second pass over what is kept. A new view keeps the occupied cells.
"""

from collections import OrderedDict
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.geometry.camera import Camera
from core.geometry.rays import Rays, pixel_centres, rays_through
from core.models.codes import Codes
from core.models.fused import filled
from core.models.model import Model
from core.rendering.folded_field import Folded
from core.rendering.occupancy import Occupancy, Overlooked, overlooked
from core.rendering.reference import Rendered

_CHUNK_RAYS = 4096
"""Rays marched at a time, about 32k evaluations: what a newer job waits for."""
_VIEWS = 8
"""Views of which it is kept what they show: as many as a picture has stages."""
_SHAPES = 8
"""Shapes of which the occupied cells are kept."""
_SIMILAR = 0.25
"""Standard deviations of the trained shapes within which one shape is looked for around another."""
_BLOCK = 8192
"""Points evaluated at a time: few enough that activations stay in cache."""


def march(
    model: Model, codes: Codes, camera: Camera, samples: int, whole: bool = True, cutoff: Overlooked | None = None
) -> Generator[None, None, Rendered]:
    """What :func:`core.rendering.reference.render_exact` draws, many times faster; returned after a chunk for every
    value.

    Where the network paints the ground itself, the ground is plain white here.

    Args:
        samples: intervals along the longest side of the scene's box; a ray has as many as fit between the first and
            the last occupied cell behind its pixel.
        whole: otherwise the shape is looked for around the one drawn last, if they are similar: meant for a shape on
            the move.
        cutoff: what of a ray is neither evaluated nor coloured; :func:`overlooked` of the samples where it is None.
    """
    with torch.inference_mode():
        folded = _folded(model, codes)
    kept = yield from _visible(folded, View(model, tuple(codes.shape.tolist()), camera, samples, whole, cutoff))
    parts = []
    for chunk in kept:
        with torch.inference_mode():
            parts.append(_coloured(folded, chunk))
        yield None
    return _picture(camera, kept, parts, model.device)


def marched(
    model: Model, codes: Codes, camera: Camera, samples: int, whole: bool = True, cutoff: Overlooked | None = None
) -> Rendered:
    """What :func:`march` returns, at once."""
    stream = march(model, codes, camera, samples, whole, cutoff)
    while True:
        try:
            next(stream)
        except StopIteration as done:
            return done.value


@dataclass(frozen=True, eq=False)
class Chunk:
    """What some rays see of a shape: their depth and opacity, and the intervals that are worth a colour."""

    pixel: Int[Tensor, "rays"]
    """of the picture, row by row"""
    directions: Float[Tensor, "rays 3"]
    depth: Float[Tensor, "rays"]
    opacity: Float[Tensor, "rays"]
    asked: Int[Tensor, "rays"]
    """intervals of each whose density was evaluated"""
    ray: Int[Tensor, "seen"]
    share: Float[Tensor, "seen"]
    """of its ray's light"""
    y: Float[Tensor, "seen width"]
    """activations from which the texture part goes on"""


class View(NamedTuple):
    """What is seen of a shape depends on these."""

    model: Model
    shape: tuple[float, ...]
    camera: Camera
    samples: int
    whole: bool
    cutoff: Overlooked | None = None


_kept: OrderedDict[View, list[Chunk]] = OrderedDict()


def keeps(model: Model, codes: Codes, camera: Camera, samples: int, whole: bool = True) -> bool:
    """Whether :func:`march` has only colours to find, as it has drawn this shape from this camera lately."""
    return View(model, tuple(codes.shape.tolist()), camera, samples, whole) in _kept


@lru_cache(maxsize=4)
def _folded(model: Model, codes: Codes) -> Folded:
    """Of the codes drawn last: a new view does not change them."""
    return Folded(model, codes)


def forget_views() -> None:
    """Keep nothing of any view: the next pictures cost what a new view costs."""
    _kept.clear()


def forget() -> None:
    """Keep nothing of any shape: the next pictures cost what a new shape costs."""
    forget_views()
    _occupied.clear()
    _folded.cache_clear()


def _visible(folded: Folded, view: View) -> Generator[None, None, list[Chunk]]:
    """What a shape shows, whatever its texture; kept for the last few views, which are the stages of a picture."""
    if view in _kept:
        _kept.move_to_end(view)
        return _kept[view]
    with torch.inference_mode():
        occupancy = _occupancy(view)
        first, last = occupancy.span(view.camera, view.model.corner)
        pixel = (first < last).flatten().nonzero()[:, 0]
        centres = pixel_centres(view.camera.width, view.camera.height, pixel.device).reshape(-1, 2)
        rays = rays_through(centres.index_select(0, pixel) - view.model.corner, view.camera, occupancy.extent)
        near = torch.maximum(rays.near, first.flatten().index_select(0, pixel))
        far = torch.minimum(rays.far, last.flatten().index_select(0, pixel))
        rays = replace(rays, near=near, far=torch.maximum(near, far))
        step = 2 * float(occupancy.extent.max()) / view.samples
        beyond = view.cutoff or overlooked(view.samples)
    chunks = []
    for start in range(0, len(rays.near), _CHUNK_RAYS):
        with torch.inference_mode():
            some = slice(start, start + _CHUNK_RAYS)
            chunks.append(_chunk(folded, occupancy, pixel[some], rays[some], step, beyond))
        yield None
    _kept[view] = chunks
    while len(_kept) > _VIEWS:
        _kept.popitem(last=False)
    return _kept[view]


_occupied: OrderedDict[tuple[Model, tuple[float, ...]], Occupancy] = OrderedDict()


def _occupancy(view: View) -> Occupancy:
    """A shape's occupied cells: kept, as neither a new view nor a new texture changes them."""
    key = view.model, view.shape
    known = _occupied.get(key)
    if known is None or (view.whole and not known.whole):
        code = torch.tensor(view.shape, device=view.model.codes.shapes.device)
        folded = Folded(view.model, Codes(code, view.model.codes.mean.texture))
        _occupied[key] = Occupancy(view.model, folded, None if view.whole else _similar(view.model, code))
    _occupied.move_to_end(key)
    while len(_occupied) > _SHAPES:
        _occupied.popitem(last=False)
    return _occupied[key]


def _similar(model: Model, code: Float[Tensor, "latent"]) -> Occupancy | None:
    """The occupied cells of the shape drawn last, where it is similar."""
    for (other, shape), occupancy in reversed(_occupied.items()):
        if other is model:
            away = model.codes.shape_space.distance(code, torch.tensor(shape, device=code.device))
            return occupancy if float(away) < _SIMILAR else None
    return None


def _chunk(folded: Folded, occupancy: Occupancy, pixel: Tensor, rays: Rays, step: float, beyond: Overlooked) -> Chunk:
    """Some rays, to the end; those that cross nothing are dropped."""
    crossed = occupancy.crossed(rays, step, beyond.spent)
    some, ray, counts = torch.unique_consecutive(crossed.ray, return_inverse=True, return_counts=True)
    pixel, rays = pixel.index_select(0, some), rays[some]
    rank = torch.arange(len(ray), device=ray.device) - (counts.cumsum(0) - counts).index_select(0, ray)
    places = rays.near.index_select(0, ray) + (crossed.interval + 0.5) * step
    points = rays.origins.index_select(0, ray) + rays.directions.index_select(0, ray) * places[:, None]
    thickness = torch.zeros(len(counts), int(counts.amax()) if len(counts) else 0, device=ray.device)
    slot = ray * thickness.shape[1] + rank
    asked, found = [], []
    for index in _rounds(ray, crossed.dark, thickness, beyond.spent):
        for part in index.split(_BLOCK):
            density, y = folded.density(folded.first(filled(points.index_select(0, part))))
            thickness.view(-1).index_copy_(0, slot.index_select(0, part), density[: len(part)] * step)
            asked.append(part)
            found.append(y[: len(part)])
    passed = torch.nn.functional.pad(thickness.cumsum(-1), (1, 0))
    light = torch.exp(-passed)
    shares, opacity = light[:, :-1] - light[:, 1:], 1 - light[:, -1]
    order, y = torch.cat(asked), torch.cat(found)
    whose = ray.index_select(0, order)
    share = shares.flatten().index_select(0, slot.index_select(0, order))
    depth = torch.zeros_like(opacity).index_add_(0, whose, share * places.index_select(0, order))
    depth = depth / opacity.clamp_min(1e-6)
    seen = (share > beyond.unseen * opacity.index_select(0, whose)).nonzero()[:, 0]
    kept = (part.index_select(0, seen) for part in (whose, share, y))
    evaluated = torch.bincount(whose, minlength=len(counts))
    return Chunk(pixel, rays.directions, depth * (opacity > 0), opacity, evaluated, *kept)


def _rounds(
    ray: Int[Tensor, "crossed"], dark: Bool[Tensor, "crossed"], thickness: Float[Tensor, "rays ranks"], spent: float
) -> Iterator[Int[Tensor, "some"]]:
    """Which of the intervals to evaluate next: those that may be seen, then the dark ones of rays that are not spent.

    ``thickness`` is filled in between.

    Args:
        ray, dark: of every interval: which ray it lies on, and whether it is expected to lie behind the object.
    """
    yield (~dark).nonzero()[:, 0]
    alive = thickness.sum(-1) < spent
    yield (dark & alive[ray]).nonzero()[:, 0]


def _coloured(folded: Folded, chunk: Chunk) -> Float[Tensor, "rays 3"]:
    """The colours of a chunk's rays, on white."""
    direction_bias = folded.direction_bias(chunk.directions)
    mixed = torch.zeros_like(chunk.directions)
    for ray, share, y in zip(*(part.split(_BLOCK) for part in (chunk.ray, chunk.share, chunk.y)), strict=True):
        colour = folded.colour(filled(y), direction_bias.index_select(0, filled(ray)))[: len(ray)]
        mixed.index_add_(0, ray, colour * share[:, None])
    total = torch.zeros_like(chunk.opacity).index_add_(0, chunk.ray, chunk.share)[:, None]
    # Where nothing weighed enough to be coloured, what little there is counts as white.
    mean = torch.where(total > 0, mixed / total.clamp_min(1e-9), 1.0)
    return torch.lerp(torch.ones_like(mean), mean, chunk.opacity[:, None])


def _picture(camera: Camera, chunks: list[Chunk], colours: list[Tensor], device: torch.device) -> Rendered:
    """The marched rays among the white ground."""
    count = camera.height * camera.width
    colour = torch.ones(count, 3, device=device)
    depth, opacity = torch.zeros(count, device=device), torch.zeros(count, device=device)
    asked = torch.zeros(count, dtype=torch.long, device=device)
    for chunk, seen in zip(chunks, colours, strict=True):
        colour[chunk.pixel], depth[chunk.pixel], opacity[chunk.pixel] = seen, chunk.depth, chunk.opacity
        asked[chunk.pixel] = chunk.asked
    size = camera.height, camera.width
    return Rendered(colour.reshape(*size, 3), depth.reshape(size), opacity.reshape(size), asked.reshape(size))
