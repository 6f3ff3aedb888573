"""Rays through pixels, clipped to the scene's box, and samples along them."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.camera import Camera, camera_directions, camera_rotation, pixel_centres


@dataclass(frozen=True)
class Rays:
    """Rays clipped to the scene's box; one that misses has ``near == far``, so no mask is needed."""

    origins: Float[Tensor, "*batch 3"]  # world
    directions: Float[Tensor, "*batch 3"]  # world, unit length
    near: Float[Tensor, "*batch"]  # scene units from the origin to the box
    far: Float[Tensor, "*batch"]  # scene units from the origin to the end of the box

    def __getitem__(self, index: object) -> "Rays":
        return Rays(self.origins[index], self.directions[index], self.near[index], self.far[index])  # type: ignore[index]


def cast_rays(
    pixels: Float[Tensor, "*#batch 2"],
    azimuth: Float[Tensor, "*#batch"],
    elevation: Float[Tensor, "*#batch"],
    distance: Float[Tensor, "*#batch"],
    focal: float | Float[Tensor, "*#batch"],
    size: tuple[int, int],
    extent: Float[Tensor, "3"],
) -> Rays:
    """Cast rays from orbit cameras through image points; differentiable in the cameras' parameters.

    Args:
        pixels: (x, y) in px from the top left corner of the image.
        azimuth, elevation, distance: rad, rad, scene units; broadcast against ``pixels``.
        focal: px.
        size: (width, height) in px; the optical axis passes through the middle.
        extent: half the size of the scene's box along each world axis.

    ``near`` and ``far`` carry no gradient: sample positions along a ray do not depend on the camera.
    """
    rotation = camera_rotation(azimuth, elevation)
    directions = (camera_directions(pixels, focal, size)[..., None, :] @ rotation)[..., 0, :]
    origins = (distance[..., None] * rotation[..., 2, :]).expand_as(directions)
    near, far = clip_to_box(origins.detach(), directions.detach(), extent)
    return Rays(origins, directions, near, far)


def camera_rays(camera: Camera, extent: Float[Tensor, "3"], pixel_offset: float = 0.0) -> Rays:
    """Return the rays through all pixel centres of a camera, shaped (height, width), on ``extent``'s device.

    Args:
        pixel_offset: px that rays pass to the left of and above the centres (:attr:`Model.pixel_offset`).
    """
    return rays_at_pixels(pixel_centres(camera.width, camera.height, extent.device) - pixel_offset, camera, extent)


def rays_at_pixels(pixels: Float[Tensor, "*batch 2"], camera: Camera, extent: Float[Tensor, "3"]) -> Rays:
    """Return the rays of a camera through points of its image: (x, y) in px from the top left corner."""
    _, origin = camera.world_to_camera(extent.device)
    directions = camera.directions(pixels)
    origins = origin.expand_as(directions)
    return Rays(origins, directions, *clip_to_box(origins, directions, extent))


def clip_to_box(
    origins: Float[Tensor, "*batch 3"], directions: Float[Tensor, "*batch 3"], extent: Float[Tensor, "3"]
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Return the distances at which rays enter and leave the box [-extent, extent]; equal for a miss."""
    safe = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    negative_side = (-extent - origins) / safe
    positive_side = (extent - origins) / safe
    near = torch.minimum(negative_side, positive_side).amax(-1).clamp_min(0.0)
    far = torch.maximum(negative_side, positive_side).amin(-1)
    return near, torch.maximum(near, far)


def uniform_edges(rays: Rays, samples: int) -> Float[Tensor, "*batch samples_and_one"]:
    """Divide each ray from near to far into ``samples`` equal intervals; return their edges in scene units."""
    steps = torch.linspace(0.0, 1.0, samples + 1, device=rays.near.device)
    return rays.near[..., None] + (rays.far - rays.near)[..., None] * steps


def midpoints(edges: Float[Tensor, "*batch samples_and_one"]) -> Float[Tensor, "*batch samples"]:
    """Return the middle of every interval."""
    return (edges[..., 1:] + edges[..., :-1]) / 2


def ray_points(rays: Rays, depths: Float[Tensor, "*batch samples"]) -> Float[Tensor, "*batch samples 3"]:
    """Return world points at ``depths``, in scene units along the rays."""
    return rays.origins[..., None, :] + depths[..., None] * rays.directions[..., None, :]
