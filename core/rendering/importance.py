"""Eq. 3 for fitting: only the samples that are seen are differentiated.

Most of a ray passes through nothing or behind a surface. A first look without gradients finds where its light goes;
the few samples that give nearly all of it are then asked again, with gradients.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.rays import Rays
from core.geometry.sampling import points_at
from core.models.model import Model
from core.rendering.compositing import weights
from core.rendering.folded_field import colours, densities
from core.rendering.reference import intervals


def render_seen(
    model: Model,
    rays: Rays,
    samples: int,
    kept: int,
    shape_bias: Float[Tensor, "objects blocks width"],
    texture_bias: Float[Tensor, "objects more_blocks width"],
) -> tuple[Float[Tensor, "objects views rays 3"], Float[Tensor, "objects views rays"]]:
    """Colour and opacity of rays, shaped (objects, views, rays), every object with its own codes.

    Differentiable in rays and biases through ``kept`` samples a ray on average: those of the largest weights among all
    samples of an object. The others keep their density, and their colour is taken to be that of the rest of their ray,
    white where there is none. With ``kept`` = ``samples`` it is :func:`core.rendering.reference.render_rays`. Where
    gradients are off, colours come from the folded field, as the densities do, so to its precision.
    """
    depths, edges = intervals(model, rays, samples)
    points = points_at(rays, depths)
    with torch.no_grad():
        looked = densities(model, points.flatten(1, 3), shape_bias).reshape(depths.shape)
        count = kept * depths[0, ..., 0].numel()
        shares, left = weights(looked, edges)
        seen = shares.flatten(1).topk(count, sorted=False).indices
    ray, objects = seen // samples, torch.arange(len(points), device=seen.device)[:, None]
    places, directions = points.flatten(1, 3)[objects, seen], rays.directions.flatten(1, 2)
    if torch.is_grad_enabled():
        density, features = model.field.density(places, shape_bias[:, None])
        direction_bias = model.field.direction_bias(directions)[objects, ray]
        rgb = model.field.colour(features, direction_bias, texture_bias[:, None])
        shares, left = weights(looked.flatten(1).scatter(1, seen, density).reshape(looked.shape), edges)
    else:
        rgb = colours(model, places, directions[objects, ray], shape_bias, texture_bias)
    share = shares.flatten(1).gather(1, seen)[..., None]
    light = torch.zeros(len(points), left[0].numel(), 4, device=seen.device)
    light = light.scatter_add(1, ray[..., None].expand(-1, -1, 4), torch.cat((share * rgb, share), -1))
    light, opacity = light.reshape(*left.shape, 4), (1 - left)[..., None]
    colour = torch.where(light[..., 3:] > 0, light[..., :3] / light[..., 3:].clamp_min(1e-6), 1.0)
    return colour * opacity + left[..., None], opacity[..., 0]
