"""Where along a ray the field is asked."""

import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.rays import Rays


def uniform_edges(rays: Rays, samples: int) -> Float[Tensor, "*batch samples_and_one"]:
    """Edges of ``samples`` equal intervals from near to far, in scene units along the ray."""
    steps = torch.linspace(0.0, 1.0, samples + 1, device=rays.near.device)
    return rays.near[..., None] + (rays.far - rays.near)[..., None] * steps


def midpoints(edges: Float[Tensor, "*batch samples_and_one"]) -> Float[Tensor, "*batch samples"]:
    """The middle of every interval."""
    return (edges[..., 1:] + edges[..., :-1]) / 2


def stratified(
    edges: Float[Tensor, "*batch samples_and_one"], generator: torch.Generator
) -> Float[Tensor, "*batch samples"]:
    """A uniformly rendered place in every interval."""
    fractions = torch.rand(edges[..., 1:].shape, generator=generator, device=edges.device)
    return torch.lerp(edges[..., :-1], edges[..., 1:], fractions)


def ray_points(rays: Rays, depths: Float[Tensor, "*batch samples"]) -> Float[Tensor, "*batch samples 3"]:
    """World points at these distances along the rays."""
    return rays.origins[..., None, :] + depths[..., None] * rays.directions[..., None, :]
