"""The exact renderer (Eq. 3): simple, slow, and the standard for all faster ones."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.edits import kinds
from core.edits.edit import Edit
from core.geometry.camera import Camera
from core.geometry.rays import Rays, camera_rays, midpoints, ray_points, uniform_edges
from core.models.model import Instance, Model
from core.models.network import with_network
from core.rendering.compositing import composite_on_white, compositing_weights
from core.rendering.outline import Outline, outline
from core.runtime.modes import isolated
from core.runtime.pool import map_pieces

_CHUNK_POINTS = 8192  # points evaluated at a time, so that activations stay in cache (32k ran up to 1.7x slower)


@dataclass(frozen=True)
class Rendered:
    """Colours, opacities and depths of a bundle of rays."""

    colour: Float[Tensor, "*batch 3"]  # on white; within [0, 1] unless the model's colours are unbounded
    depth: Float[Tensor, "*batch"]
    """scene units along the ray in the object's own space, mean over the samples by weight; 0 for empty rays"""
    opacity: Float[Tensor, "*batch"]  # 0..1, one minus the transmittance
    evaluations: Int[Tensor, "*batch"] | None = None  # samples with evaluated density; None: the same for all rays

    @classmethod
    def joined(cls, bands: Iterable["Rendered"]) -> "Rendered":
        """Join bands of rows, from top to bottom, to one image without evaluations."""
        values = zip(*((band.colour, band.depth, band.opacity) for band in bands), strict=True)
        return cls(*(torch.cat(pieces) for pieces in values))


def sample_intervals(
    model: Model, rays: Rays, samples: int
) -> tuple[Float[Tensor, "*batch samples"], Float[Tensor, "*batch edges"]]:
    """Return the depths of each ray's samples and the edges of their intervals; scene units along the ray.

    Samples are at the middle of equal intervals. If the network paints the background (``white_from_network``), they
    are the authors': equally spaced with one at either end of the ray, each at the near edge of its interval, and the
    last interval has no end (1e10).
    """
    if model.white_from_network:
        depths = uniform_edges(rays, samples - 1)
        return depths, torch.cat((depths, depths[..., -1:] + 1e10), -1)
    edges = uniform_edges(rays, samples)
    return midpoints(edges), edges


def render_rays(
    model: Model,
    rays: Rays,
    samples: int,
    shape_bias: Float[Tensor, "... blocks width"],
    texture_bias: Float[Tensor, "... more_blocks width"],
    bound: Outline | None = None,
    edits: tuple[Edit, ...] = (),
) -> Rendered:
    """Evaluate Eq. 3 with ``samples`` uniform intervals per ray, differentiable in rays and biases.

    Args:
        shape_bias, texture_bias: from the field; broadcast against (*batch, samples, blocks, width).
        bound: outline that bounds the density.
        edits: of the object, in whose space the rays are.
    """
    depths, edges = sample_intervals(model, rays, samples)
    direction_bias = model.field.direction_bias(rays.directions)[..., None, :]
    points = ray_points(rays, depths)
    origins = kinds.origins(points, edits)
    density, colours = model.field.radiance(origins, direction_bias, shape_bias, texture_bias)
    density = kinds.densities(density, edits)
    head = model.part_head
    activations = model.field.activations
    colours = kinds.colours(colours, edits, lambda: head.parts(activations(origins, shape_bias)) if head else {})
    if bound is not None:
        density = density * bound.factor(points)
    weights, transmittance = compositing_weights(density, edges)
    opacity = 1 - transmittance
    depth = (weights * depths).sum(-1) / opacity.clamp_min(1e-6)
    return Rendered(composite_on_white(weights, transmittance, colours), depth * (opacity > 0), opacity)


def exact_rays(model: Model, camera: Camera) -> Rays:
    """Return the rays of a camera's pixels, shaped (height, width).

    If the network paints the background, these are the authors': through pixel corners, and from depth
    ``camera.distance`` - 0.5 to + 0.5 at every pixel. Otherwise rays go through pixel centres, clipped to the box.
    """
    if not model.white_from_network:
        return camera_rays(camera, model.extent_tensor)
    rays = camera_rays(camera, model.extent_tensor, model.pixel_offset)
    near = torch.full_like(rays.near, camera.distance - 0.5)
    return replace(rays, near=near, far=near + 1.0)


@isolated
@torch.no_grad()
def render_exact(instance: Instance, camera: Camera, samples: int = 256) -> Rendered:
    """Render every pixel with every sample in float32: the standard for all faster renderers."""
    model = with_network(instance.model, instance.codes)
    rays = exact_rays(model, instance.local_camera(camera))
    bounded = *instance.biases, outline(instance), instance.codes.field_edits
    rows = max(1, _CHUNK_POINTS // (camera.width * samples))
    starts = range(0, camera.height, rows)
    bands = map_pieces(lambda row: render_rays(model, rays[row : row + rows], samples, *bounded), starts)
    return Rendered.joined(bands)
