"""Importance sampling for fitting: Eq. 3 with gradients only through the samples of largest weight.

Most of a ray passes through empty space or behind a surface. A first pass without gradients finds the weights; the few
samples with nearly all of the light are then evaluated with gradients.
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.geometry.rays import Rays, ray_points
from core.models.model import Model
from core.rendering.compositing import compositing_weights
from core.rendering.folded_layers import batch_colour, batch_density
from core.rendering.reference import sample_intervals

MIN_WEIGHT = 1e-3  # fraction of a ray's light: most samples weigh less and are neither coloured nor differentiated
_STEP = 256
"""The number of chosen samples is rounded up to a multiple of this: oneDNN compiles a kernel for every number of rows,
which takes longer than running it and keeps up to half a megabyte."""


def largest_weights(
    weights: Float[Tensor, "objects views rays samples"], coloured: int, min_weight: float
) -> Int[Tensor, "objects top"]:
    """Return the indices of each object's samples of largest weight: ``coloured`` per ray on average, or all.

    Indices are into the flattened (views, rays, samples). Fewer samples are returned if no object has so many whose
    weight (fraction of a ray's light) exceeds ``min_weight``; then the number is rounded up to a multiple of 256.
    """
    flat = weights.flatten(1)
    count = min(coloured, weights.shape[-1]) * weights[0, ..., 0].numel()
    if min_weight > 0 and coloured < weights.shape[-1]:
        weighing = int((flat > min_weight).sum(1).amax())
        count = min(count, max(1, -(-weighing // _STEP)) * _STEP)
    return flat.topk(count, sorted=False).indices


def render_top_samples(
    model: Model,
    rays: Rays,
    samples: int,
    coloured: int,
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
    cells: Bool[Tensor, "#objects x y z"] | None = None,
    present: Model | None = None,
) -> Float[Tensor, "objects views rays 4"]:
    """Render rays of (objects, views, rays): red, green, blue and opacity.

    Only the samples of largest weight are coloured and differentiated in rays and biases: ``coloured`` per ray on
    average. The other samples keep their density and take the mean colour of their ray, white if it has none.
    With ``coloured`` = ``samples``, the render equals that of :func:`core.rendering.reference.render_rays`. Without
    gradients, colours have the precision of the folded field, as densities always do.

    Args:
        samples: intervals of each ray.
        cells: see :func:`core.rendering.folded_layers.batch_density`.
        present: constant copy of a model whose weights are being trained, for all that is not differentiated.
    """
    differentiable = torch.is_grad_enabled()
    depths, edges = sample_intervals(model, rays, samples)
    points = ray_points(rays, depths).flatten(1, 3)
    with torch.no_grad():
        densities = batch_density(present or model, points, shape_bias, cells)
        weights, transmittance = compositing_weights(densities.reshape(depths.shape), edges)
        top = largest_weights(weights, coloured, 0.0 if differentiable else MIN_WEIGHT)
    ray = top // samples
    objects = torch.arange(len(points), device=top.device)[:, None]
    positions = points[objects, top]
    directions = rays.directions.flatten(1, 2)
    if differentiable:
        density, features = model.field.density(positions, shape_bias[:, None])
        density = density * (densities.gather(1, top) > 0)  # empty outside of the cells
        direction_bias = model.field.direction_bias(directions)[objects, ray]
        rgb = model.field.colour(features, direction_bias, texture_bias[:, None])
        weights, transmittance = compositing_weights(densities.scatter(1, top, density).reshape(depths.shape), edges)
    else:
        rgb = batch_colour(model, positions, directions[objects, ray], shape_bias, texture_bias)
    weight = weights.flatten(1).gather(1, top)[..., None]
    light = torch.zeros(len(points), transmittance[0].numel(), 4, device=rgb.device)
    light = light.scatter_add(1, ray[..., None].expand(-1, -1, 4), torch.cat((weight * rgb, weight), -1))
    light = light.reshape(*transmittance.shape, 4)
    # All light of a ray has the mean colour of its top samples.
    colour = torch.where(light[..., 3:] > 0, light[..., :3] / light[..., 3:].clamp_min(1e-6), 1.0)
    transmittance = transmittance[..., None]
    return torch.cat((colour * (1 - transmittance) + transmittance, 1 - transmittance), -1)
