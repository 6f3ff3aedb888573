"""The jacobian of rendered rays: the derivatives of every channel with respect to ray and codes.

Rays are independent, so one backward pass through the field differentiates one channel of all rays. Here the gradients
of all channels propagate together; autograd would need a pass for each. They are summed over each ray, then mapped from
the field's biases to the estimated coordinates of the codes.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional
from torch.nn.functional import pad

from core.geometry.rays import Rays, ray_points
from core.models.density import density_derivative
from core.models.field import encode
from core.models.model import Model
from core.rendering.compositing import compositing_weights
from core.rendering.folded_layers import FieldWeights, batch_density, field_weights
from core.rendering.importance import MIN_WEIGHT, largest_weights
from core.rendering.reference import sample_intervals
from core.runtime.layers import chunk_points, linear_relu, relu_, relu_backward_
from core.runtime.precision import matmul_dtype


class BiasJacobians(NamedTuple):
    """Derivatives of the field's biases with respect to the estimated numbers (coordinates) of the codes.

    Without the last axis, each bias depends on a number of its own, in the same order.
    """

    shape: Float[Tensor, "objects blocks width *shape_numbers"]
    texture: Float[Tensor, "objects more_blocks width *texture_numbers"]


class RenderedJacobian(NamedTuple):
    """The channels of rays (red, green, blue and opacity) and their derivatives."""

    channels: Float[Tensor, "objects views rays channels"]
    origin: Float[Tensor, "objects views rays channels 3"]  # with respect to the ray's origin
    direction: Float[Tensor, "objects views rays channels 3"]
    """with respect to the ray's direction, which moves the samples and is the viewing direction"""
    shape: Float[Tensor, "objects views rays channels shape_numbers"]  # with respect to the numbers of the shape code
    texture: Float[Tensor, "objects views rays 3 texture_numbers"]  # of the texture code, which does not change opacity


@torch.no_grad()
def render_with_jacobian(
    model: Model,
    rays: Rays,
    samples: int,
    coloured: int,
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
    bias_jacobians: BiasJacobians,
    cells: Bool[Tensor, "#objects x y z"] | None = None,
) -> RenderedJacobian:
    """Render rays like :func:`core.rendering.importance.render_top_samples`, with the jacobian.

    Rays are (objects, views, rays).
    """
    depths, edges = sample_intervals(model, rays, samples)
    points = ray_points(rays, depths).flatten(1, 3)
    density = batch_density(model, points, shape_bias, cells).reshape(depths.shape)
    sample_weights, transmittance = compositing_weights(density, edges)
    top = largest_weights(sample_weights, coloured, MIN_WEIGHT).sort().values
    ray = top // samples
    objects = torch.arange(len(points), device=top.device)[:, None]
    top_points = points[objects, top]
    directions = rays.directions.flatten(1, 2)[objects, ray]
    weights = field_weights(model, matmul_dtype(model.device.type))
    chunks = list(_chunks(top.shape, chunk_points(weights.features.dtype)))
    colours = torch.empty_like(top_points)
    activations = []
    for chunk in chunks:
        biases = shape_bias[chunk[0]], texture_bias[chunk[0]]
        forward, colours[chunk] = _forward(model, weights, top_points[chunk], directions[chunk], *biases)
        activations.append(forward)
    channels, by_colour, by_thickness = _composite(colours, sample_weights, transmittance, top)
    by_logit = density_derivative(density.flatten(1).gather(1, top), model.field.config)
    # An interval without end is opaque at any density.
    lengths = edges.diff(dim=-1).flatten(1).gather(1, top)[..., None]
    by_density = by_thickness * lengths.where(lengths < 1e9, 0.0)
    depth = depths.flatten(1).gather(1, top)
    # The samples of a ray share its origin, direction and biases, so gradients are summed before they are mapped to the
    # codes.
    sums = list[Tensor]()
    row = ray + objects * transmittance[0].numel()
    for chunk, forward in zip(chunks, activations, strict=True):
        gradients = _backward(weights, forward, by_colour[chunk], by_density[chunk], by_logit[chunk], depth[chunk])
        sums = sums or [gradient.new_zeros(transmittance.numel(), *gradient.shape[2:]) for gradient in gradients]
        _add_by_ray(sums, gradients, row[chunk].flatten())
    origin, direction, *by_bias = sums
    by_shape = _along_codes(by_bias[: len(weights.shape_blocks)], bias_jacobians.shape)
    by_texture = _along_codes(by_bias[len(weights.shape_blocks) :], bias_jacobians.texture)
    by_ray = origin, direction, by_shape, by_texture
    return RenderedJacobian(channels, *(values.unflatten(0, transmittance.shape) for values in by_ray))


def _add_by_ray(sums: list[Tensor], gradients: Sequence[Tensor], row: Int[Tensor, "samples"]) -> None:
    """Add the gradients of samples to those of their rays, in place; ``row`` is the ray of each, ascending."""
    rows = slice(int(row[0]), int(row[-1]) + 1)
    starts = torch.searchsorted(row, torch.arange(rows.start, rows.stop, device=row.device))
    order = torch.arange(len(row), device=row.device)
    for total, gradient in zip(sums, gradients, strict=True):
        by_rows = functional.embedding_bag(order, gradient.flatten(0, 1).flatten(1), starts, mode="sum")
        total[rows] += by_rows.unflatten(1, total.shape[1:])


def _along_codes(
    gradients: Sequence[Float[Tensor, "rays channels width"]],
    jacobian: Float[Tensor, "objects blocks width *numbers"],
) -> Float[Tensor, "rays channels numbers"]:
    """Map derivatives by the biases of blocks to derivatives by the numbers of the object's code."""
    by_bias = torch.cat(list(gradients), -1)
    of_object = by_bias.unflatten(0, (len(jacobian), -1))
    entries = jacobian.flatten(1, 2)
    if entries.ndim == 2:  # each bias is a number of its own
        of_object.mul_(entries[:, None, None])
        return by_bias.float()
    return (of_object.flatten(1, 2) @ entries.to(by_bias.dtype)).float().reshape(*by_bias.shape[:2], -1)


def _composite(
    colours: Float[Tensor, "objects top 3"],
    sample_weights: Float[Tensor, "objects views rays samples"],
    transmittance: Float[Tensor, "objects views rays"],
    top: Int[Tensor, "objects top"],
) -> tuple[
    Float[Tensor, "objects views rays channels"],
    Float[Tensor, "objects top 3"],
    Float[Tensor, "objects top channels"],
]:
    """Composite rays (Eq. 3). Return them, and their derivatives by colours and optical depths of the top samples.

    Args:
        colours: of the top samples; the others take the mean colour of their ray.
        top: indices of the top samples into (views, rays, samples).
    """
    samples = sample_weights.shape[-1]
    objects = len(transmittance)
    count = transmittance[0].numel()
    ray = top // samples
    weight = sample_weights.flatten(1).gather(1, top)[..., None]
    index = ray[..., None].expand(-1, -1, 4)
    light = torch.zeros(objects, count, 4, device=top.device)
    light = light.scatter_add_(1, index, torch.cat((weight * colours, weight), -1))
    total = light[..., 3:].clamp_min(1e-6)
    remaining = transmittance.flatten(1)[..., None]
    mean = torch.where(light[..., 3:] > 0, light[..., :3] / total, 1.0)
    colour = mean * (1 - remaining) + remaining
    # The light behind a sample is its ray's total less the light up to the sample.
    filled = mean[:, :, None].repeat(1, 1, samples, 1).flatten(1, 2)
    filled = filled.scatter_(1, top[..., None].expand(-1, -1, 3), colours).unflatten(1, (count, samples))
    light_so_far = (filled * sample_weights.reshape(objects, count, samples, 1)).cumsum(2).flatten(1, 2)
    passing = 1 - sample_weights.cumsum(-1).flatten(1).gather(1, top)[..., None]
    behind = colour.gather(1, index[..., :3]) - light_so_far.gather(1, top[..., None].expand(-1, -1, 3))
    dimmed = remaining.gather(1, ray[..., None])
    by_thickness = torch.cat((passing * colours - behind, dimmed), -1)
    by_colour = (weight * ((1 - remaining) / total).gather(1, ray[..., None])).expand(-1, -1, 3)
    channels = torch.cat((colour.reshape(*transmittance.shape, 3), 1 - transmittance[..., None]), -1)
    return channels, by_colour, by_thickness


class _Activations(NamedTuple):
    """Values of the forward pass that the backward pass needs."""

    position_derivative: Float[Tensor, "objects samples encoded"]
    """derivative of each number of :func:`core.models.field.encode` along its axis"""
    direction_derivative: Float[Tensor, "objects samples more_encoded"]  # likewise for the direction
    shape: tuple[Float[Tensor, "objects samples width"], ...]  # after each layer of the shape part
    texture: tuple[Float[Tensor, "objects samples _"], ...]  # after each layer of the texture part
    rgb_derivative: Float[Tensor, "objects samples 3"]  # of rgb with respect to the last layer's output


def _forward(
    model: Model,
    weights: FieldWeights,
    points: Float[Tensor, "objects samples 3"],
    directions: Float[Tensor, "objects samples 3"],
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
) -> tuple[_Activations, Float[Tensor, "objects samples 3"]]:
    """Return the activations and colours of some samples."""
    config = model.field.config
    dtype = weights.features.dtype
    position = encode(points, config.position_frequencies)
    direction = encode(directions, config.direction_frequencies)
    y = linear_relu(position.to(dtype), *weights.position.layer)
    shape = [y]
    for weight, bias in zip(weights.shape_blocks, shape_bias.to(dtype).unbind(-2), strict=True):
        y = relu_(functional.linear(y, weight).add_(bias[:, None]))
        shape.append(y)
    y = functional.linear(y, weights.features).add_(functional.linear(direction.to(dtype), *weights.direction.layer))
    texture = [relu_(y)]
    for weight, bias in zip(weights.texture_blocks, texture_bias.to(dtype).unbind(-2), strict=True):
        y = relu_(functional.linear(y, weight).add_(bias[:, None]))
        texture.append(y)
    y = linear_relu(y, *weights.hidden)
    texture.append(y)
    colour = functional.linear(y, *weights.rgb).float()
    rgb_derivative = torch.ones_like(colour)
    if config.bounded_colour:
        colour = colour.sigmoid()
        rgb_derivative = colour * (1 - colour)
    position_derivative = _encoding_derivative(position, config.position_frequencies)
    direction_derivative = _encoding_derivative(direction, config.direction_frequencies)
    return _Activations(position_derivative, direction_derivative, tuple(shape), tuple(texture), rgb_derivative), colour


def _encoding_derivative(encoded: Float[Tensor, "*batch encoded"], frequencies: int) -> Float[Tensor, "*batch encoded"]:
    """Return the derivative of each encoded value along its axis."""
    scales = (2.0 ** torch.arange(frequencies, device=encoded.device)).repeat_interleave(3)
    values, sines, cosines = encoded.split((3, 3 * frequencies, 3 * frequencies), -1)
    return torch.cat((torch.ones_like(values), cosines * scales, -sines * scales), -1)


def _backward(
    weights: FieldWeights,
    activations: _Activations,
    by_colour: Float[Tensor, "objects samples 3"],
    by_density: Float[Tensor, "objects samples channels"],
    by_logit: Float[Tensor, "objects samples"],
    depth: Float[Tensor, "objects samples"],
) -> list[Tensor]:
    """Return derivatives of each ray's channels, by way of single samples.

    They are with respect to the ray's origin and direction, the bias of each shape block, and that of each texture
    block, which does not change opacity.

    Args:
        by_colour: derivative of a colour channel with respect to the same channel of the sample.
        by_density: derivative of each channel with respect to the sample's density.
        by_logit: derivative of the density with respect to its logit.
        depth: scene units from the ray's origin.
    """
    dtype = weights.features.dtype
    # Texture does not change opacity: its channel enters with the density.
    gradient = (by_colour * activations.rgb_derivative).to(dtype)[..., None] * weights.rgb[0]
    gradient = relu_backward_(gradient, activations.texture[-1][:, :, None]) @ weights.hidden[0]
    gradient, texture = _backward_blocks(gradient, activations.texture[:-1], weights.texture_blocks)
    by_direction = _along_axes(gradient @ weights.direction.layer[0], activations.direction_derivative)
    from_density = (by_density * by_logit[..., None]).to(dtype)[..., None] * weights.density[0][0]
    from_density[:, :, :3] += gradient @ weights.features
    gradient = from_density
    gradient, shape = _backward_blocks(gradient, activations.shape, weights.shape_blocks)
    by_position = _along_axes(gradient @ weights.position.layer[0], activations.position_derivative)
    by_direction = pad(by_direction, (0, 0, 0, by_density.shape[-1] - 3)).addcmul_(by_position, depth[..., None, None])
    return [by_position, by_direction, *shape, *texture]


def _backward_blocks(
    gradient: Float[Tensor, "objects samples channels width"],
    activations: Sequence[Float[Tensor, "objects samples width"]],
    blocks: Sequence[Float[Tensor, "width width"]],
) -> tuple[
    Float[Tensor, "objects samples channels width"], tuple[Float[Tensor, "objects samples channels width"], ...]
]:
    """Propagate gradients back through blocks and the ReLU before them; return them with those of the biases."""
    along_biases = []
    for y, weight in zip(activations[:0:-1], reversed(blocks), strict=True):
        gradient = relu_backward_(gradient, y[:, :, None])
        along_biases.append(gradient)
        gradient = gradient @ weight
    return relu_backward_(gradient, activations[0][:, :, None]), tuple(reversed(along_biases))


def _along_axes(
    gradient: Float[Tensor, "objects samples channels encoded"], encoded: Float[Tensor, "objects samples encoded"]
) -> Float[Tensor, "objects samples channels 3"]:
    """Map derivatives with respect to encoded values to derivatives with respect to the three axes."""
    axes = torch.eye(3, device=gradient.device).repeat(gradient.shape[-1] // 3, 1)
    return (gradient.float() * encoded[:, :, None]) @ axes


def _chunks(shape: torch.Size, limit: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of (objects, samples) with at most ``limit`` points in all."""
    objects, count = shape
    group = max(1, limit // count)
    for first in range(0, objects, group):
        for start in range(0, count, limit):
            yield slice(first, first + group), slice(start, start + limit)
