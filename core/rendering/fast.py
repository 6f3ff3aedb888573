"""The fast renderer: evaluates occupied cells only, front to back, and colours visible intervals only.

It has two passes, like the field. The first finds the visible intervals of a shape (:class:`Chunk`), which do not
depend on the texture and are cached: a new texture runs only the second pass, which colours them. A new view reuses
the occupied cells.
"""

from collections.abc import Callable, Generator, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.geometry.camera import Camera
from core.geometry.rays import Rays, rays_at_pixels
from core.models.model import Instance
from core.rendering.folded_field import FoldedField, clear_folded
from core.rendering.occupancy import Occupancy, Tolerances, shape_occupancy, tolerances
from core.rendering.outline import outline
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, Cached, CacheKind, byte_count
from core.runtime.layers import pad_rows
from core.runtime.pool import map_pieces
from core.streams import run_to_end

CHUNK_RAYS = 2048  # rays that a thread evaluates at a time, about 16k evaluations: the longest wait of a newer job
_BLOCK = 4096  # points evaluated at a time, so that activations stay in cache


def render_steps(
    instance: Instance, camera: Camera, samples: int, complete: bool = True
) -> Generator[None, None, Rendered]:
    """Render like :func:`core.rendering.reference.render_exact`, many times faster.

    Yields None after every chunk of rays and returns the render. A model whose network paints the background is
    rendered on plain white. Raises ``ValueError`` for M1 and M2 (:mod:`core.models.architecture_variants`).

    Args:
        samples: intervals along the longest side of the scene's box; a ray has as many as fit between the first and
            the last occupied cell behind its pixel.
        complete: that of :func:`core.rendering.occupancy.shape_occupancy`.
    """
    folded = FoldedField.of(instance)
    shade = partial(_shade, folded)
    key = _key(instance, camera, samples, complete)
    cached: Sequence[Chunk] | None = CACHE.get(CacheKind.VIEW, key)
    if cached is None:
        visible, slices = _visibility(folded, instance, instance.local_camera(camera), samples, complete)
        shaded = map_pieces(lambda rays: shade(visible(rays)), slices)
    else:
        shaded = map_pieces(shade, cached)
    depth, opacity = torch.zeros(2, camera.height * camera.width, device=folded.device)
    image = torch.ones(len(depth), 3, device=folded.device), depth, opacity, torch.zeros_like(depth, dtype=torch.long)
    chunks = list[Chunk]()
    keep = cached is None
    size = 0
    done = 0.0
    for chunk, colour in shaded:
        with torch.inference_mode():
            for channel, values in zip(image, (colour, chunk.depth, chunk.opacity, chunk.evaluations), strict=True):
                channel[chunk.pixel] = values
        size += byte_count(chunk)
        done += chunk.fraction
        # Visibility is buffered until the view is complete; skip buffering if it would exceed the cache.
        keep = keep and CACHE.make_room(CacheKind.VIEW, round(size / done))
        chunks.append(chunk) if keep else chunks.clear()
        yield None
    if keep:
        CACHE.put(CacheKind.VIEW, key, chunks, size)
    return Rendered(*(channel.unflatten(0, (camera.height, camera.width)) for channel in image))


def render(instance: Instance, camera: Camera, samples: int, complete: bool = True) -> Rendered:
    """Return the result of :func:`render_steps`, in one call."""
    return run_to_end(render_steps(instance, camera, samples, complete))


@dataclass(frozen=True, eq=False)
class Chunk(Cached):
    """A shape as seen by some rays: depth, opacity and the intervals to colour."""

    pixel: Int[Tensor, "rays"]  # index of each ray's pixel, row by row
    directions: Float[Tensor, "rays 3"]
    depth: Float[Tensor, "rays"]
    opacity: Float[Tensor, "rays"]
    evaluations: Int[Tensor, "rays"]  # intervals of each ray whose density was evaluated
    ray: Int[Tensor, "visible"]
    weight: Float[Tensor, "visible"]  # fraction of its ray's light
    features: Float[Tensor, "visible width"]  # input of the texture part
    fraction: float  # the chunk's fraction of the view's rays, including empty ones


def is_cached(instance: Instance, camera: Camera, samples: int, complete: bool = True) -> bool:
    """True if the visible intervals of the view are cached: a render with these arguments only evaluates colours."""
    return CACHE.get(CacheKind.VIEW, _key(instance, camera, samples, complete)) is not None


def _key(instance: Instance, camera: Camera, samples: int, complete: bool) -> Hashable:
    """Return everything that the visible intervals of a view depend on."""
    shape = instance.model, instance.codes.shape_key, outline(instance)
    return *shape, instance.local_camera(camera), samples, complete


def clear_views() -> None:
    """Clear the cached visible intervals: the next render costs as much as a new view."""
    CACHE.clear(CacheKind.VIEW)


def clear_cache() -> None:
    """Clear cached views, shapes and folded fields: the next render costs as much as a new shape."""
    CACHE.clear(CacheKind.VIEW, CacheKind.SHAPE)
    clear_folded()


def _visibility(
    folded: FoldedField, instance: Instance, camera: Camera, samples: int, complete: bool
) -> tuple[Callable[[slice], Chunk], list[slice]]:
    """Return a function that finds the visible intervals of some rays, and the slices of rays to call it with.

    Args:
        camera: of the object's own space.
    """
    pixel_offset = instance.model.pixel_offset
    with torch.inference_mode():
        occupancy = shape_occupancy(instance, complete)
        first, last = occupancy.depth_range(camera, pixel_offset)
        pixel = (first < last).flatten().nonzero()[:, 0]
        first = first.flatten().index_select(0, pixel)
        last = last.flatten().index_select(0, pixel)
        step = 2 * float(occupancy.extent.max()) / samples
        limits = tolerances(samples)

    def visible(piece: slice) -> Chunk:
        with torch.inference_mode():
            index = pixel[piece]
            centres = torch.stack((index % camera.width, index // camera.width), -1) + 0.5
            rays = rays_at_pixels(centres - pixel_offset, camera, occupancy.extent)
            # Rays are limited to the first and the last occupied cell behind their pixel.
            near = torch.maximum(rays.near, first[piece])
            rays = replace(rays, near=near, far=torch.maximum(near, torch.minimum(rays.far, last[piece])))
            return _chunk(folded, occupancy, index, rays, step, limits, len(index) / len(pixel))

    size = max(1, min(CHUNK_RAYS, -(-len(pixel) // 2)))  # of a small image, two threads take a half each
    return visible, [slice(start, start + size) for start in range(0, len(pixel), size)]


def _chunk(
    folded: FoldedField,
    occupancy: Occupancy,
    pixel: Tensor,
    rays: Rays,
    step: float,
    tolerances: Tolerances,
    fraction: float,
) -> Chunk:
    """Trace rays, a ``fraction`` of the view's, to the end; drop rays that meet no occupied cell."""
    occupied = occupancy.intersect(rays, step, tolerances.termination)
    hits, ray, counts = torch.unique_consecutive(occupied.ray, return_inverse=True, return_counts=True)
    pixel = pixel.index_select(0, hits)
    rays = rays[hits]
    rank = torch.arange(len(ray), device=ray.device) - (counts.cumsum(0) - counts).index_select(0, ray)
    depths = rays.near.index_select(0, ray) + (occupied.interval + 0.5) * step
    points = rays.origins.index_select(0, ray) + rays.directions.index_select(0, ray) * depths[:, None]
    thickness = torch.zeros(len(counts), int(counts.amax()) if len(counts) else 0, device=ray.device)
    slot = ray * thickness.shape[1] + rank
    evaluated = list[Int[Tensor, "block"]]()
    activations = list[Float[Tensor, "block width"]]()
    # Intervals that are probably visible, then those behind the object, of rays that are not yet opaque.
    for occluded in (False, True):
        alive = thickness.sum(-1) < tolerances.termination
        for block in ((occupied.occluded == occluded) & alive[ray]).nonzero()[:, 0].split(_BLOCK):
            density, features = folded.density(pad_rows(points.index_select(0, block)))
            thickness.view(-1).index_copy_(0, slot.index_select(0, block), density[: len(block)] * step)
            evaluated.append(block)
            activations.append(features[: len(block)])
    optical_depth = torch.nn.functional.pad(thickness.cumsum(-1), (1, 0))
    transmittance = torch.exp(-optical_depth)
    opacity = 1 - transmittance[:, -1]
    order = torch.cat(evaluated)
    owner = ray.index_select(0, order)
    weights = transmittance[:, :-1] - transmittance[:, 1:]
    weight = weights.flatten().index_select(0, slot.index_select(0, order))
    depth = torch.zeros_like(opacity).index_add_(0, owner, weight * depths.index_select(0, order))
    depth = depth / opacity.clamp_min(1e-6)
    visible = (weight > tolerances.min_weight * opacity.index_select(0, owner)).nonzero()[:, 0]
    ray, weight, features = (values.index_select(0, visible) for values in (owner, weight, torch.cat(activations)))
    evaluations = torch.bincount(owner, minlength=len(counts))
    return Chunk(pixel, rays.directions, depth * (opacity > 0), opacity, evaluations, ray, weight, features, fraction)


@torch.inference_mode()
def _shade(folded: FoldedField, chunk: Chunk) -> tuple[Chunk, Float[Tensor, "rays 3"]]:
    """Return a chunk and the colours of its rays, on white."""
    direction_bias = folded.direction_bias(chunk.directions)
    mixed = torch.zeros_like(chunk.directions)
    for ray, weight, features in zip(
        *(values.split(_BLOCK) for values in (chunk.ray, chunk.weight, chunk.features)), strict=True
    ):
        colour = folded.colour(pad_rows(features), direction_bias.index_select(0, pad_rows(ray)))[: len(ray)]
        mixed.index_add_(0, ray, colour * weight[:, None])
    total = torch.zeros_like(chunk.opacity).index_add_(0, chunk.ray, chunk.weight)[:, None]
    # Rays without a coloured interval count as white.
    mean = torch.where(total > 0, mixed / total.clamp_min(1e-9), 1.0)
    return chunk, torch.lerp(torch.ones_like(mean), mean, chunk.opacity[:, None])
