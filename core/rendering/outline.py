"""The outline of photos bounds the object: there is no density where a photo's camera saw background.

Fog around and between thin parts is the field's doubt about edges, which the mask of a photo settles for its own view.
A density is multiplied by its point's share of every mask, seen from the photo's camera with a soft margin; where the
photo paints the other side too, also by the share of the mirrored point (-x, y, z). Fits never see it.
"""

from dataclasses import replace
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
from core.models.photo_detail import BACKGROUND, PhotoView

FADED = 1.5  # standard deviations of shape edits at which the detail has vanished
_UNSURE, _SURE = 0.5, 0.7  # confidence in the camera below which no detail is shown, and from which all is
_HEIGHT = 512  # px of a map of distances
_AROUND = _HEIGHT // 8  # px of background around the photo
_AGREEING = 0.97  # share of the mask's rays that cross the mirrored mask, from which on the object is symmetric
_CHECKED = 64  # px across, and samples of a ray, for that


def shown_share(model: Model, codes: Codes) -> float:
    """Return the strength of the photo detail, 0..1: lower for a doubtful camera, fading as the shape is edited.

    A texture repaints the detail and does not fade it.
    """
    detail = codes.detail
    if detail is None or model.white_from_network or model.is_ablation:
        return 0.0
    away = float(model.codes.shape_space.distance(codes.shape, detail.shape))
    sure = min(1.0, max(0.0, (detail.confidence - _UNSURE) / (_SURE - _UNSURE)))
    return detail.strength * sure * max(0.0, 1 - away / FADED)


class Silhouette(NamedTuple):
    """A photo's mask with its margin; equal for equal photos."""

    view: PhotoView
    margin: float  # focal lengths

    def share(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return 1 for points whose images lie within half the margin of the mask, 0 beyond the margin."""
        camera, distances = _distances(self.view)
        local = camera.to_camera_axes(points)
        scale = 2 * camera.focal / (-local[..., 2]).clamp_min(1e-6)
        place = torch.stack((local[..., 0] * scale / camera.width, -local[..., 1] * scale / camera.height), -1)
        distance = functional.grid_sample(
            distances.to(points.device), place.reshape(1, 1, -1, 2), padding_mode="border", align_corners=False
        )
        return (2 - 2 * distance / self.margin).clamp(0, 1).reshape(points.shape[:-1])


class Outline(NamedTuple):
    """The masks that bound an object."""

    silhouettes: tuple[Silhouette, ...]
    mirrored: tuple[bool, ...]  # which bound the other side too

    def share(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return the share of density that points keep, 0..1."""
        kept = torch.ones_like(points[..., 0])
        for silhouette, mirrored in zip(self.silhouettes, self.mirrored, strict=True):
            kept = kept * silhouette.share(points)
            if mirrored:
                kept = kept * silhouette.share(_mirror(points))
        return kept


def outline(model: Model, codes: Codes) -> Outline | None:
    """Return the outline that bounds codes; None where none does.

    Margins widen without bound as photo detail fades, so the outline goes with it.
    """
    share, detail = shown_share(model, codes), codes.detail
    if not share or detail is None:
        return None
    bounding = [Silhouette(view, view.outline_margin) for view in detail.views if view.outline_margin]
    mirrored = tuple(detail.other_side != "model" and _is_symmetric(one, model.extent) for one in bounding)
    widened = tuple(one._replace(margin=one.margin / share) for one in bounding)
    return Outline(widened, mirrored) if bounding else None


def coherence(silhouette: Silhouette, extent: tuple[float, float, float]) -> float:
    """Return the share of the mask whose rays cross the mirrored mask within the scene's box.

    All do where the object is symmetric and the camera is right.
    """
    camera, _ = _distances(silhouette.view)
    wide = max(1, round(_CHECKED * camera.width / camera.height))
    rays = camera_rays(camera.resized(wide, _CHECKED), torch.tensor(extent))
    points = ray_points(rays, midpoints(uniform_edges(rays, _CHECKED)))
    on_mask = silhouette.share(points.select(-2, _CHECKED // 2)) == 1
    crossed = (silhouette.share(_mirror(points)) > 0).any(-1)
    return float((on_mask & crossed).sum() / on_mask.sum().clamp_min(1))


@lru_cache(maxsize=16)
def _is_symmetric(silhouette: Silhouette, extent: tuple[float, float, float]) -> bool:
    return coherence(silhouette, extent) >= _AGREEING


@lru_cache(maxsize=16)
def _distances(view: PhotoView) -> tuple[Camera, Float[Tensor, "1 1 rows columns"]]:
    """Return the camera of a map, and the map: focal lengths from each pixel to a photo's mask, 0 on the mask."""
    from scipy.ndimage import distance_transform_edt

    height, width = _HEIGHT, max(1, round(_HEIGHT * view.camera.width / view.camera.height))
    opacity = torch.from_numpy(view.pixels()[None, ..., 3].copy()).float() / 255
    background = functional.adaptive_avg_pool2d(opacity, (height, width))[0].numpy() < BACKGROUND
    outside = np.pad(background, _AROUND, constant_values=True)
    camera = view.camera.resized(width, height)
    camera = replace(camera, width=width + 2 * _AROUND, height=height + 2 * _AROUND)
    with torch.inference_mode(False):  # cached
        distance = torch.from_numpy(distance_transform_edt(outside).astype(np.float32))
        return camera, ((distance - 0.5).clamp_min(0) / camera.focal)[None, None]  # the edge lies between pixels


def _mirror(points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    return points * points.new_tensor([-1.0, 1.0, 1.0])
