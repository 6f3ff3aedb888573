"""What a photo adds to the colours of a surface: looked up where a point of the surface is in the photo.

The photo's residual (photo less render, times its weight) is a map over the image of the photo's camera, beside it the
distance and the normal of the surface that the camera saw. A point takes the residual of the pixel it projects into, as
far as it is the surface that was seen there (a soft depth test) and is seen from the same side. What the photo's camera
did not see takes the low-passed residual of its mirror image (-x, y, z), if that was seen. Opacity and depth are only
read.
"""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays
from core.rendering.reference import Rendered

DEPTH_NEAR, DEPTH_FAR = 0.012, 0.035
"""scene units along the photo's ray between a point and what was seen: up to the first it is that, from the second on
something else"""
FACING = 0.25
"""cosine between the ray that sees a point and the surface, from which on it counts as seen from the photo's side"""
FLAT, STEEP = math.cos(math.radians(75)), math.cos(math.radians(55))
"""cosines between the photo's ray and the surface: nothing is taken below, all above"""
BESIDE = math.cos(math.radians(25)), math.cos(math.radians(8))
"""cosines between the photo's ray and the one that sees a point: from beside the photo, it is right however flatly the
surface is seen"""
MIN_OPACITY = 0.02
"""of a pixel that takes anything"""


@dataclass(frozen=True, eq=False)
class DetailMaps:
    """Maps over the image of a photo's camera. Never written again."""

    camera: Camera
    """at any size: maps are over its whole image"""
    fine: tuple[Float[Tensor, "4 _ _"], ...]
    """weight times residual (rgb, sRGB), and weight; each level has half the pixels across of the one before"""
    mirrored: Float[Tensor, "3 rows columns"]
    """the same, low-passed, times the share that a mirror image takes"""
    surface: Float[Tensor, "4 rows columns"]
    """unit normal (world) and distance from the camera (scene units)"""
    strength: float = 1.0
    """times all that is added"""

    @property
    def size(self) -> int:
        """bytes"""
        return sum(part.nbytes for part in (*self.fine, self.mirrored, self.surface))

    def level(self, camera: Camera) -> int:
        """Which level of the fine map has pixels about as large as a camera's are on the object."""
        own = self.camera.focal * self.fine[0].shape[1] / self.camera.height / self.camera.distance
        ratio = own * camera.distance / camera.focal
        return max(0, min(len(self.fine) - 1, round(math.log2(max(ratio, 1e-6)))))

    def added(self, rendered: Rendered, camera: Camera, extent: Float[Tensor, "3"]) -> Rendered:
        """A render in its camera's image with the photo's detail; its opacity and depth stay the same tensors."""
        if not self.strength:
            return rendered
        index = (rendered.opacity.flatten() > MIN_OPACITY).nonzero()[:, 0]
        rays = camera_rays(camera, extent)
        directions = rays.directions.flatten(0, 1).index_select(0, index)
        points = rays.origins[0, 0] + directions * rendered.depth.flatten().index_select(0, index)[:, None]
        opacity = rendered.opacity.flatten().index_select(0, index)[:, None]
        found = opacity * self.at(points, directions, self.level(camera))
        colour = rendered.colour.flatten(0, 1).index_add(0, index, found).clamp(0, 1)
        return replace(rendered, colour=colour.view_as(rendered.colour))

    def at(
        self, points: Float[Tensor, "points 3"], directions: Float[Tensor, "points 3"], level: int = 0
    ) -> Float[Tensor, "points 3"]:
        """What is added to the colours of places on a surface.

        Args:
            directions: unit vectors along which each is seen; against the outward normal for a mesh.
            level: of the fine map.
        """
        fine, seen = self._seen(points, directions, self.fine[level])
        direct = fine * seen[:, None]
        turn = torch.tensor([-1.0, 1.0, 1.0], device=points.device)
        soft, twin = self._seen(points * turn, directions * turn, self.mirrored)
        return self.strength * (direct[:, :3] + ((1 - direct[:, 3]) * twin)[:, None] * soft)

    def _seen(
        self, points: Float[Tensor, "points 3"], directions: Float[Tensor, "points 3"], map: Tensor
    ) -> tuple[Float[Tensor, "points channels"], Float[Tensor, "points"]]:
        """A map's values where points project into it, and how far the photo's camera saw these points (0..1)."""
        rotation, origin = self.camera.world_to_camera(points.device)
        away = points - origin
        local = away @ rotation.T
        scale = 2 * self.camera.focal / (-local[:, 2]).clamp_min(1e-6)
        place = torch.stack((local[:, 0] * scale / self.camera.width, -local[:, 1] * scale / self.camera.height), -1)
        surface, distance = _sampled(self.surface, place), away.norm(dim=-1)
        ray = away / distance[:, None].clamp_min(1e-6)
        same = smooth_step((distance - surface[:, 3]).abs(), DEPTH_FAR, DEPTH_NEAR)
        facing = smooth_step(-(directions * surface[:, :3]).sum(-1), 0.0, FACING)
        steep = smooth_step(-(ray * surface[:, :3]).sum(-1), FLAT, STEEP)
        beside = smooth_step((ray * directions).sum(-1), *BESIDE)
        return _sampled(map, place), same * torch.maximum(facing * steep, beside) * (local[:, 2] < 0)


def _sampled(map: Float[Tensor, "channels h w"], place: Float[Tensor, "points 2"]) -> Float[Tensor, "points channels"]:
    """Bilinear; 0 beyond the image."""
    return functional.grid_sample(map[None], place[None, None], align_corners=False)[0, :, 0].T


def smooth_step(value: Float[Tensor, "*any"], zero: float, one: float) -> Float[Tensor, "*any"]:
    """0 up to one bound and 1 from the other on, without an edge between."""
    share = ((value - zero) / (one - zero)).clamp(0, 1)
    return share * share * (3 - 2 * share)
