"""How every pixel changes with every number of a hypothesis: the Jacobian of rendered rays.

A ray depends on no other ray, so one pass back through the field gives the slopes of all rays in one channel at once:
red, green, blue and opacity go back together. While they are still per sample they are taken to the numbers that are
searched for; then they are summed over each ray. Autograd would keep the four passes apart.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional
from torch.nn.functional import pad

from core.geometry.rays import Rays
from core.geometry.sampling import points_at
from core.models.field import encode
from core.models.fused import held_back_, linear_relu, rectify_
from core.models.model import Model
from core.models.precision import linear_dtype
from core.rendering.compositing import weights
from core.rendering.folded_field import densities, field_weights
from core.rendering.reference import intervals

_CHUNK_POINTS = 8192
"""Points taken back at a time: with fewer, calls cost more than leaving the cache does."""


class Entries(NamedTuple):
    """How the numbers searched for enter the field: slopes of its biases."""

    shape: Float[Tensor, "objects blocks width shape_numbers"]
    texture: Float[Tensor, "objects more_blocks width texture_numbers"]


class Traced(NamedTuple):
    """Rays, and how each of their channels (red, green, blue, opacity) changes."""

    colour: Float[Tensor, "objects views rays 3"]
    opacity: Float[Tensor, "objects views rays"]
    origin: Float[Tensor, "objects views rays 4 3"]
    """slopes along the ray's origin"""
    direction: Float[Tensor, "objects views rays 4 3"]
    """slopes along the ray's direction, of the samples' places and of what is seen from there"""
    codes: Float[Tensor, "objects views rays 4 numbers"]
    """slopes along the numbers of the shape, then of the texture"""


@torch.no_grad()
def trace(
    model: Model,
    rays: Rays,
    samples: int,
    kept: int,
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
    entries: Entries,
) -> Traced:
    """What :func:`core.rendering.importance.render_seen` renders, with its Jacobian; shaped (objects, views, rays)
    likewise.
    """
    depths, edges = intervals(model, rays, samples)
    points = points_at(rays, depths).flatten(1, 3)
    looked = densities(model, points, shape_bias).reshape(depths.shape)
    shares, left = weights(looked, edges)
    count = min(kept, samples) * left[0].numel()
    seen = shares.flatten(1).topk(count, sorted=False).indices.sort().values
    ray, objects = seen // samples, torch.arange(len(points), device=seen.device)[:, None]
    chunks = list(_chunks(*seen.shape))
    colours, passages = torch.empty(*seen.shape, 3, device=seen.device), []
    for some in chunks:
        chosen, owners = seen[some], objects[some[0]]
        directions = rays.directions.flatten(1, 2)[owners, ray[some]]
        passed, colours[some] = _passed(
            model, points[owners, chosen], directions, shape_bias[some[0]], texture_bias[some[0]]
        )
        passages.append(passed)
    found = _composed(colours, shares, left, seen)
    steep = _steepness(model, looked.flatten(1).gather(1, seen))
    # An interval without end is opaque whatever its density.
    lengths = edges.diff(dim=-1).flatten(1).gather(1, seen)[..., None]
    by_density = found.by_depth * lengths.where(lengths < 1e9, 0.0)
    along = depths.flatten(1).gather(1, seen)
    numbers = entries.shape.shape[-1] + entries.texture.shape[-1]
    summed = torch.zeros(left.numel(), 4 * (6 + numbers), device=seen.device)
    place = ray + objects * left[0].numel()
    for some, passed in zip(chunks, passages, strict=True):
        entered = Entries(entries.shape[some[0]], entries.texture[some[0]])
        slopes = _back(model, passed, found.by_colour[some], by_density[some], steep[some], along[some], entered)
        summed.index_add_(0, place[some].flatten(), slopes.flatten(0, 1).flatten(1))
    summed = summed.reshape(*left.shape, 4, -1)
    return Traced(found.colour, found.opacity, *summed.split((3, 3, numbers), -1))


class _Composed(NamedTuple):
    """Rays composed of their samples; how they change with the colours and optical depths of those that are kept."""

    colour: Float[Tensor, "objects views rays 3"]
    opacity: Float[Tensor, "objects views rays"]
    by_colour: Float[Tensor, "objects kept 3"]
    by_depth: Float[Tensor, "objects kept 4"]


def _composed(colours: Tensor, shares: Tensor, left: Tensor, seen: Tensor) -> _Composed:
    samples = shares.shape[-1]
    objects, count = len(left), left[0].numel()
    ray = seen // samples
    share = shares.flatten(1).gather(1, seen)[..., None]
    index = ray[..., None].expand(-1, -1, 4)
    light = torch.zeros(objects, count, 4, device=seen.device)
    light = light.scatter_add_(1, index, torch.cat((share * colours, share), -1))
    total, gone = light[..., 3:].clamp_min(1e-6), left.flatten(1)[..., None]
    mean = torch.where(light[..., 3:] > 0, light[..., :3] / total, 1.0)
    colour = mean * (1 - gone) + gone
    # Behind a sample lies what its ray shows in all, less what the samples up to it give.
    filled = mean[:, :, None].repeat(1, 1, samples, 1).flatten(1, 2)
    filled = filled.scatter_(1, seen[..., None].expand(-1, -1, 3), colours).unflatten(1, (count, samples))
    given = (filled * shares.reshape(objects, count, samples, 1)).cumsum(2).flatten(1, 2)
    passing = 1 - shares.cumsum(-1).flatten(1).gather(1, seen)[..., None]
    at = seen[..., None].expand(-1, -1, 3)
    behind = colour.gather(1, index[..., :3]) - given.gather(1, at)
    dimmed = gone.gather(1, ray[..., None])
    by_depth = torch.cat((passing * colours - behind, dimmed), -1)
    by_colour = (share * ((1 - gone) / total).gather(1, ray[..., None])).expand(-1, -1, 3)
    return _Composed(colour.reshape(*left.shape, 3), 1 - left, by_colour, by_depth)


def _steepness(model: Model, density: Tensor) -> Tensor:
    """Of density along its logit: a softplus ends where its slope is a sigmoid."""
    scale = model.field.config.density_scale
    return scale * -torch.expm1(-density / scale)


class _Passed(NamedTuple):
    """What some samples left behind on their way through the field, shaped (objects, samples, width)."""

    encoded: Tensor
    """slopes of the encoded place along the axes, as :func:`core.models.field.encode` orders it"""
    seen_along: Tensor
    """the same of the direction"""
    shape: tuple[Tensor, ...]
    """activations after each layer of the shape part"""
    texture: tuple[Tensor, ...]
    """and of the texture part"""
    rgb: Tensor
    """of the last layer's output"""


def _passed(
    model: Model, points: Tensor, directions: Tensor, shape_bias: Tensor, texture_bias: Tensor
) -> tuple[_Passed, Tensor]:
    """Also the colours."""
    config, weights = model.field.config, field_weights(model, linear_dtype(model.device.type))
    dtype = weights.direction.dtype
    place, look = encode(points, config.point_octaves), encode(directions, config.direction_octaves)
    y = linear_relu(place.to(dtype), *weights.point.layer)
    shape = [y]
    for weight, bias in zip(weights.shape_blocks, shape_bias.to(dtype).unbind(-2), strict=True):
        y = rectify_(functional.linear(y, weight).add_(bias[:, None]))
        shape.append(y)
    y = functional.linear(y, weights.direction).add_(functional.linear(look.to(dtype), *weights.view.layer))
    texture = [rectify_(y)]
    for weight, bias in zip(weights.texture_blocks, texture_bias.to(dtype).unbind(-2), strict=True):
        y = rectify_(functional.linear(y, weight).add_(bias[:, None]))
        texture.append(y)
    y = linear_relu(y, *weights.hidden)
    texture.append(y)
    colour = functional.linear(y, *weights.rgb).float()
    steep = torch.ones_like(colour)
    if config.bounded_colour:
        colour = colour.sigmoid()
        steep = colour * (1 - colour)
    turned, looked = _turned(place, config.point_octaves), _turned(look, config.direction_octaves)
    return _Passed(turned, looked, tuple(shape), tuple(texture), steep), colour


def _turned(encoded: Tensor, octaves: int) -> Tensor:
    """The slope of each encoded value along its axis."""
    frequencies = (2.0 ** torch.arange(octaves, device=encoded.device)).repeat_interleave(3)
    values, sines, cosines = encoded.split((3, 3 * octaves, 3 * octaves), -1)
    return torch.cat((torch.ones_like(values), cosines * frequencies, -sines * frequencies), -1)


def _back(
    model: Model, passed: _Passed, by_colour: Tensor, by_density: Tensor, steep: Tensor, along: Tensor, entries: Entries
) -> Float[Tensor, "objects samples 4 numbers"]:
    """Slopes of four channels of each sample's ray: along origin, direction and codes.

    Args:
        by_colour: (objects, samples, 3), of a channel along the sample's own.
        by_density: (objects, samples, 4).
        steep: (objects, samples), of the density along its logit.
        along: (objects, samples), distance from the ray's origin.
    """
    weights = field_weights(model, linear_dtype(model.device.type))
    dtype = weights.direction.dtype
    g = pad((by_colour * passed.rgb).diag_embed(), (0, 0, 0, 1)).to(dtype) @ weights.rgb[0]
    g = held_back_(g, passed.texture[-1][:, :, None]) @ weights.hidden[0]
    g, texture = _through(g, passed.texture[:-1], weights.texture_blocks, entries.texture)
    looked = _along_axes(g @ weights.view.layer[0], passed.seen_along)
    by_logit = (by_density * steep[..., None]).to(dtype).reshape(-1, 1) @ weights.density[0]
    g = torch.addmm(by_logit, g.flatten(0, 2), weights.direction).reshape(g.shape)
    g, shape = _through(g, passed.shape, weights.shape_blocks, entries.shape)
    place = _along_axes(g @ weights.point.layer[0], passed.encoded)
    slopes = torch.empty(*place.shape[:3], 6 + shape.shape[-1] + texture.shape[-1], device=place.device)
    parts = place, place * along[..., None, None] + looked, shape, texture
    # torch.cat is slower where formats differ.
    for part, to in zip(parts, slopes.split([part.shape[-1] for part in parts], -1), strict=True):
        to.copy_(part)
    return slopes


def _through(
    g: Tensor, activations: Sequence[Tensor], blocks: Sequence[Tensor], entries: Tensor
) -> tuple[Tensor, Tensor]:
    """Slopes taken back through blocks and the rectifier before them; and what they are along the blocks' numbers."""
    numbers = torch.zeros((), dtype=g.dtype, device=g.device)
    for y, weight, entry in zip(activations[:0:-1], reversed(blocks), reversed(entries.unbind(1)), strict=True):
        g = held_back_(g, y[:, :, None])
        numbers = torch.baddbmm(numbers, g.flatten(1, 2), entry)
        g = g @ weight
    return held_back_(g, activations[0][:, :, None]), numbers.unflatten(1, g.shape[1:3])


def _along_axes(slopes: Tensor, encoded: Tensor) -> Tensor:
    """From the encoded values to the three axes."""
    axes = torch.eye(3, device=slopes.device).repeat(slopes.shape[-1] // 3, 1)
    return (slopes.float() * encoded[:, :, None]) @ axes


def _chunks(objects: int, count: int) -> Iterator[tuple[slice, slice]]:
    """Some samples of some objects at a time."""
    group = max(1, _CHUNK_POINTS // count)
    for first in range(0, objects, group):
        for start in range(0, count, _CHUNK_POINTS):
            yield slice(first, first + group), slice(start, start + _CHUNK_POINTS)
