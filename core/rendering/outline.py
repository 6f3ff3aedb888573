"""The outline of photos bounds the object: density fades where a photo's camera saw background.

Fog around and between thin parts is the field's doubt about edges, which the mask of a photo settles for its own view.
A density is multiplied by its point's share of every mask, widened by a margin, seen from the photo's camera; where the
photo paints the other side too, also by the share of the mirrored point (-x, y, z). Fits never see it.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays, midpoints, ray_points, uniform_edges
from core.models.codes import Codes
from core.models.model import Model
from core.models.photo_detail import PhotoView

FADED = 1.5  # standard deviations that the codes have moved, when nothing is left of photo detail
_UNSURE, _SURE = 0.5, 0.7  # confidence in the camera below which nothing is shown, and from which on all of it is
_HEIGHT = 256  # px of a map of distances
_AROUND = _HEIGHT // 8  # px of background around the photo
_FADE = 1.5  # margins from the mask at which density has faded; it begins to at one
_AGREEING = 0.97  # share of the mask's rays that the mirrored mask leaves something of, where the object is symmetric
_CHECKED = 64  # px across, and samples of a ray, for that


def shown_share(model: Model, codes: Codes) -> float:
    """Return how much of their detail codes show: less for a doubtful camera, fading as the shape is edited.

    A texture repaints the detail and does not fade it.
    """
    detail = codes.detail
    if detail is None or model.white_from_network or model.is_ablation:
        return 0.0
    away = float(model.codes.shape_space.distance(codes.shape, detail.shape))
    sure = min(1.0, max(0.0, (detail.confidence - _UNSURE) / (_SURE - _UNSURE)))
    return detail.strength * sure * max(0.0, 1 - away / FADED)


class Silhouette(NamedTuple):
    """A photo's mask as the distances to it; compared and hashed by the photo."""

    view: PhotoView
    camera: Camera  # of the map, which is larger than the photo
    margin: float  # focal lengths

    @property
    def distance(self) -> Float[Tensor, "1 1 rows columns"]:
        """Focal lengths from each pixel to the mask; 0 on it."""
        return _distances(self.view)[1]

    def share(self, points: Float[Tensor, "*batch 3"], widened: float = 1.0) -> Float[Tensor, "*batch"]:
        """Return 1 for points whose images lie on the mask or within its widened margin, 0 well beyond."""
        local = self.camera.to_camera_axes(points)
        scale = 2 * self.camera.focal / (-local[..., 2]).clamp_min(1e-6)
        place = torch.stack((local[..., 0] / self.camera.width, -local[..., 1] / self.camera.height), -1)
        place = (place * scale[..., None]).reshape(1, 1, -1, 2)
        distance = functional.grid_sample(
            self.distance.to(points.device), place, padding_mode="border", align_corners=False
        )
        reach = self.margin * widened
        return ((_FADE * reach - distance) / ((_FADE - 1) * reach)).clamp(0, 1).reshape(points.shape[:-1])


class Outline(NamedTuple):
    """The masks of all photos of an object."""

    silhouettes: tuple[Silhouette, ...]
    mirrored: tuple[bool, ...]  # which bound the other side too
    widened: float  # margins are so many times as wide: they grow without bound as photo detail fades

    def share(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return what is left of densities at points, 0..1."""
        left = torch.ones_like(points[..., 0])
        for silhouette, mirrored in zip(self.silhouettes, self.mirrored, strict=True):
            left = left * silhouette.share(points, self.widened)
            if mirrored:
                left = left * silhouette.share(_mirror(points), self.widened)
        return left


def outline(model: Model, codes: Codes) -> Outline | None:
    """Return the outline that bounds codes as far as their photo detail is shown; None where nothing does."""
    share, detail = shown_share(model, codes), codes.detail
    if not share or detail is None:
        return None
    found = [_silhouette(view) for view in detail.views]
    silhouettes = tuple(one for one in found if one)
    both = detail.other_side != "model"
    mirrored = tuple(both and _agrees(one, model.extent) for one in silhouettes)
    return Outline(silhouettes, mirrored, 1 / share) if silhouettes else None


def _silhouette(view: PhotoView) -> Silhouette | None:
    if view.outline_margin is None:
        return None
    return Silhouette(view, _distances(view)[0], view.outline_margin)


@lru_cache(maxsize=16)
def _distances(view: PhotoView) -> tuple[Camera, Float[Tensor, "1 1 rows columns"]]:
    """The map of a photo, and its camera."""
    from scipy.ndimage import distance_transform_edt

    height, width = _HEIGHT, max(1, round(_HEIGHT * view.camera.width / view.camera.height))
    opacity = torch.from_numpy(view.pixels()[None, ..., 3].copy()).float() / 255
    mask = functional.adaptive_avg_pool2d(opacity, (height, width))[0].numpy() > 0.5
    outside = np.pad(~mask, _AROUND, constant_values=True)
    camera = view.camera.resized(width, height)
    grown = Camera(
        camera.azimuth, camera.elevation, camera.distance, camera.focal, width + 2 * _AROUND, height + 2 * _AROUND
    )
    distance = torch.from_numpy(distance_transform_edt(outside).astype(np.float32))
    return grown, (distance / camera.focal)[None, None]


@lru_cache(maxsize=16)
def _agrees(silhouette: Silhouette, extent: tuple[float, float, float]) -> bool:
    return coherence(silhouette, extent) >= _AGREEING


def coherence(silhouette: Silhouette, extent: tuple[float, float, float]) -> float:
    """Return the share of the mask whose rays cross the mirrored mask within the scene's box.

    All do of a symmetric object that is seen from the right camera.
    """
    camera = silhouette.camera
    wide = max(1, round(_CHECKED * camera.width / camera.height))
    rays = camera_rays(camera.resized(wide, _CHECKED), torch.tensor(extent))
    points = ray_points(rays, midpoints(uniform_edges(rays, _CHECKED)))
    on_mask = silhouette.share(points.select(-2, _CHECKED // 2)) == 1
    crossed = (silhouette.share(_mirror(points)) > 0).any(-1)
    return float((on_mask & crossed).sum() / on_mask.sum().clamp_min(1))


def _mirror(points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    return points * points.new_tensor([-1.0, 1.0, 1.0])
