"""The fast renderer: only occupied cells are evaluated, front to back, and only what is seen is coloured."""

from collections.abc import Generator
from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.camera import Camera
from core.codes import Codes
from core.folded import Folded
from core.model import Model
from core.occupancy import Occupancy
from core.rays import Rays, camera_rays
from core.render import Rendered
from core.sampling import points_at

_CHUNK_RAYS = 2048
"""Rays marched at a time, about 16k evaluations: what a newer job waits for."""
_ROUND = 6
"""Occupied intervals of a ray that are evaluated before it is looked at whether its light is spent."""
_SPENT = 6.2
"""Optical thickness behind which nothing is seen: 0.2 % of the light is left."""
_UNSEEN = 0.1
"""An interval that weighs less than this share of an even weight is not coloured; the others make up for it."""


def march(model: Model, codes: Codes, camera: Camera, samples: int) -> Generator[None, None, Rendered]:
    """What :func:`core.render.render_exact` draws, many times faster; returned after a chunk for every value.

    Args:
        samples: intervals along the longest side of the scene's box; a ray has as many as fit between the first and
            the last occupied cell behind its pixel.
    """
    with torch.inference_mode():
        folded, occupancy = Folded(model, codes), _occupancy(model, tuple(codes.shape.tolist()))
        first, last = occupancy.span(camera)
        hit = (first < last).to(model.device)
        rays = camera_rays(camera, model.extent_tensor)[hit]
        near, far = torch.maximum(rays.near, first[hit]), torch.minimum(rays.far, last[hit])
        rays = replace(rays, near=near, far=torch.maximum(near, far))
        step = 2 * max(model.extent) / samples
    parts = []
    for start in range(0, len(rays.near), _CHUNK_RAYS):
        with torch.inference_mode():
            parts.append(_chunk(folded, occupancy, rays[start : start + _CHUNK_RAYS], step))
        yield None
    return _picture(hit, parts)


@lru_cache(maxsize=8)
def _occupancy(model: Model, shape: tuple[float, ...]) -> Occupancy:
    """A shape's occupied cells: kept, as neither a new view nor a new texture changes them."""
    codes = Codes(torch.tensor(shape, device=model.device), model.codes.mean.texture)
    return Occupancy(model, Folded(model, codes))


def _chunk(folded: Folded, occupancy: Occupancy, rays: Rays, step: float) -> Rendered:
    """Some rays, to the end."""
    count = int(((rays.far - rays.near).amax() / step).ceil().clamp_min(1))
    places = rays.near[:, None] + (torch.arange(count, device=rays.near.device) + 0.5) * step
    points = points_at(rays, places)
    waiting = occupancy.holds(points) & (places < rays.far[:, None])
    thickness, found = _thickness(folded, points, waiting, step)
    passed = torch.nn.functional.pad(thickness.cumsum(-1), (1, 0))
    light = torch.exp(-passed)
    shares, left = light[:, :-1] * -torch.expm1(-thickness), light[:, -1]
    opacity = 1 - left
    colour = _coloured(folded, rays, shares, found) * opacity[:, None] + left[:, None]
    depth = (shares * places).sum(-1) / opacity.clamp_min(1e-6)
    return Rendered(colour, depth * (opacity > 0), opacity)


def _thickness(
    folded: Folded, points: Float[Tensor, "rays samples 3"], waiting: Bool[Tensor, "rays samples"], step: float
) -> tuple[Float[Tensor, "rays samples"], list[tuple[Tensor, Tensor, Tensor]]]:
    """Optical thickness of the waiting intervals, round by round until a ray's light is spent.

    With it, per round: the rays and the intervals evaluated, and their activations.
    """
    rank = waiting.cumsum(-1)
    thickness, found = torch.zeros(waiting.shape, device=waiting.device), []
    longest = int(rank[:, -1].amax()) if waiting.numel() else 0
    for done in range(0, longest, _ROUND):
        alive = thickness.sum(-1) < _SPENT
        now = waiting & (rank > done) & (rank <= done + _ROUND) & alive[:, None]
        ray, sample = now.nonzero(as_tuple=True)
        density, y = folded.density(folded.first(points[ray, sample]))
        thickness[ray, sample] = density * step
        found.append((ray, sample, y))
    return thickness, found


def _coloured(
    folded: Folded, rays: Rays, shares: Float[Tensor, "rays samples"], found: list[tuple[Tensor, Tensor, Tensor]]
) -> Float[Tensor, "rays 3"]:
    """The mean colour of what each ray sees of the object."""
    total, mixed = torch.zeros_like(rays.near), torch.zeros_like(rays.origins)
    direction_bias = folded.direction_bias(rays.directions)
    for ray, sample, y in found:
        share = shares[ray, sample]
        seen = share > _UNSEEN / shares.shape[-1]
        ray, share = ray[seen], share[seen]
        mixed.index_add_(0, ray, share[:, None] * folded.colour(y[seen], direction_bias[ray]))
        total.index_add_(0, ray, share)
    # Where nothing weighed enough to be coloured, what little there is counts as white.
    return torch.where(total[:, None] > 0, mixed / total[:, None].clamp_min(1e-9), 1.0)


def _picture(hit: Bool[Tensor, "height width"], parts: list[Rendered]) -> Rendered:
    """The marched rays among the white ground."""
    colour = torch.ones(*hit.shape, 3, device=hit.device)
    depth, opacity = torch.zeros(hit.shape, device=hit.device), torch.zeros(hit.shape, device=hit.device)
    if parts:
        colour[hit] = torch.cat([part.colour for part in parts])
        depth[hit] = torch.cat([part.depth for part in parts])
        opacity[hit] = torch.cat([part.opacity for part in parts])
    return Rendered(colour, depth, opacity)
