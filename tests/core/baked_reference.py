"""The shader of :mod:`core.gl.baked_shader` in torch: a plain reference for what OpenGL draws."""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.geometry.rays import Rays, camera_rays, ray_points
from core.gl.baked_field import LOGITS, BakedField
from core.models.density import logits_to_density
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.occupancy import CELLS
from core.rendering.reference import Rendered

_CHUNK_RAYS = 4096


@torch.no_grad()
def render_baked(baked: BakedField, camera: Camera) -> Rendered:
    """Render a baked field as the shader draws it, on white, without shadow."""
    camera = camera.stretched(baked.proportions)
    rays = camera_rays(camera, torch.tensor(baked.extent), baked.pixel_offset)
    lines = max(1, _CHUNK_RAYS // camera.width)
    bands = [rays[first : first + lines] for first in range(0, camera.height, lines)]
    texels = torch.from_numpy(baked.texels).float().movedim(-1, 0)[None] / 255
    rendered = Rendered.joined(_march(band, baked, texels) for band in bands)
    return baked.detail.added(rendered, camera)[0] if baked.detail else rendered


def _march(rays: Rays, baked: BakedField, texels: Float[Tensor, "1 4 x y z"]) -> Rendered:
    """Render rays through the occupied cells of a baked field; ``texels`` are its texels, 0..1."""
    extent = torch.tensor(baked.extent)
    count = max(1, math.ceil(float((rays.far - rays.near).max()) / baked.step))
    depths = rays.near[..., None] + (torch.arange(count) + 0.5) * baked.step
    place = ray_points(rays, depths) / extent
    cell = ((place + 1) * (CELLS / 2)).long().clamp(0, CELLS - 1)
    occupied = (depths < rays.far[..., None]) & torch.from_numpy(baked.distance == 0)[cell.unbind(-1)]
    corner = (place[occupied] + 1) * (baked.cells / 2) - torch.tensor(baked.first)
    within = 2 * corner / (torch.tensor(baked.texels.shape[:3]) - 1) - 1
    samples = torch.zeros(*depths.shape, 4)
    samples[occupied] = functional.grid_sample(
        texels, within.flip(-1)[None, None, None], padding_mode="border", align_corners=True
    )[0, :, 0, 0].T
    logit = LOGITS[0] + (LOGITS[1] - LOGITS[0]) * samples[..., 3]
    density = occupied * logits_to_density(logit, baked.config)
    edges = functional.pad(depths + baked.step / 2, (1, 0))
    edges[..., 0] = rays.near
    weights, left = compositing_weights(density, edges)
    depth = (weights * depths).sum(-1) / (1 - left).clamp_min(1e-6)
    return Rendered(composite_on_white(weights, left, samples[..., :3]), depth * (left < 1), 1 - left)
