"""Sample placement along training rays: evenly over the lit part of a ray within its object's hull.

All rays have the same number of samples, so that codes enter as one bias per ray and all shapes are fixed, as compilers
for graphics cards require. Thin objects get short intervals, and empty space is not evaluated.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.geometry.rays import Rays, ray_points

_BINS = 128  # per ray, to look up the hull; finer than its cells
_COARSE = 32  # samples that find how far light reaches
_DARK = 7.0  # optical depth at which a thousandth of the light is left


class PlacedSamples(NamedTuple):
    """Samples of rays and their intervals."""

    points: Float[Tensor, "rays samples 3"]
    edges: Float[Tensor, "rays samples_and_one"]  # scene units within the hull, from its first entry


@torch.no_grad()
def place_samples(
    rays: Rays,
    jitter: Float[Tensor, "rays samples"],
    inside: Callable[[Float[Tensor, "rays bins 3"]], Bool[Tensor, "rays bins"]],
    coarse_density: Callable[[Float[Tensor, "rays coarse 3"]], Float[Tensor, "rays coarse"]] | None,
) -> PlacedSamples:
    """Place one sample in each of ``samples`` equal parts of a ray's path through its hull.

    Args:
        jitter: random place of each sample in its part, 0..1.
        inside: tells which points lie in the hull of their ray's object.
        coarse_density: density per scene unit, used to skip unlit parts; None keeps the whole path.
    """
    device = rays.near.device
    samples = jitter.shape[1]
    width = ((rays.far - rays.near) / _BINS)[:, None]
    middles = rays.near[:, None] + width * (torch.arange(_BINS, device=device) + 0.5)
    filled = inside(ray_points(rays, middles)).float().cumsum(-1)  # bins in the hull up to each bin

    def points_at(depths: Float[Tensor, "rays points"]) -> Float[Tensor, "rays points 3"]:
        """Return points at these distances along each ray, counted in bins within the hull."""
        index = torch.searchsorted(filled, depths, right=True).clamp_(max=_BINS - 1)
        within = (depths - (filled.gather(1, index) - 1)).clamp(0, 1)
        return ray_points(rays, rays.near[:, None] + width * (index + within))

    length = filled[:, -1:].contiguous()  # of the sampled path, in bins
    if coarse_density is not None:
        depths = (torch.arange(_COARSE, device=device) + 0.5) / _COARSE * length
        depth = (coarse_density(points_at(depths)) * (length * width / _COARSE)).cumsum(-1)
        lit = (depth < _DARK).sum(-1, keepdim=True)
        length = length * ((lit + 2) / _COARSE).clamp_max(1.0)
    steps = torch.arange(samples, device=device)
    edges = torch.arange(samples + 1, device=device) / samples * (length * width)
    return PlacedSamples(points_at((steps + jitter) / samples * length), edges)
