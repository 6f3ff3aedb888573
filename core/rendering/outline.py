"""The outline of photos bounds the object, and makes it opaque inside.

The field leaves fog around and between thin parts, where it is uncertain about edges; the mask of a photo shows where
they are. A point's density is multiplied by its weight in every mask: 1 inside, falling to 0 over a soft margin.
Inside, it is multiplied by the gain that makes the fitted object opaque along the photo's ray. If the photo also
colours the other side, and the mask is symmetric, weight and gain of the mirrored point (-x, y, z) count too. Only
renders are bounded, never the field during a fit.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.edits import kinds
from core.edits.edit import Edit
from core.geometry.camera import Camera
from core.geometry.rays import camera_rays, midpoints, ray_points, uniform_edges
from core.models.model import Instance
from core.models.motion import edits_to_fitted, unmoved_distance
from core.models.network import with_network
from core.models.photo_detail import BACKGROUND, PhotoView
from core.rendering.folded_layers import batch_density
from core.rendering.shape_cells import shape_cells
from core.runtime.modes import usual_settings

FADED = 1.5  # distance of an edited shape, in standard deviations, at which the detail has vanished
_HEIGHT = 512  # px of the photo in a map of distances
_PADDING = _HEIGHT // 8  # px of background added around the photo
_SYMMETRIC_ABOVE = 0.97  # least coherence of a symmetric object
_OPAQUE = 3.0  # optical depth to reach on a mask
_MAX_GAIN = 8.0  # largest gain to reach it
_GAIN_HEIGHT = 192  # px, height of the map of gains
_GAIN_SAMPLES = 64  # samples of a ray for the map of gains
_COHERENCE_SAMPLES = 64  # height of the image in px, and samples of a ray, for the coherence


def effective_strength(instance: Instance) -> float:
    """Return the effective strength of an object's photo detail, 0..1.

    Fades as the shape becomes another one, but neither along directions, with which the detail moves, nor with the
    texture, which repaints it. 0 for the authors' checkpoints and for M1 and M2.
    """
    detail = instance.detail
    model = instance.model
    if detail is None or model.white_from_network or model.is_ablation:
        return 0.0
    away = unmoved_distance(instance)
    return detail.strength * max(0.0, 1 - away / FADED)


class Silhouette(NamedTuple):
    """A photo's mask with its margin, and the object fitted to it. Compared by value: it is a cache key."""

    view: PhotoView
    margin: float  # focal lengths
    fitted: Instance

    def weight(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return 1 for points that project within half the margin of the mask, 0 beyond the margin, linear between."""
        camera, distances = _distances(self.view)
        return self._weight(_look_up(distances, camera, points)[0])

    def weight_and_gain(
        self, points: Float[Tensor, "*batch 3"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """Return :meth:`weight`, and the gain (at least 1) that makes the fitted object opaque along a point's ray."""
        camera, _ = _distances(self.view)
        distance, gain = _look_up(_distances_and_gains(self.fitted, self.view), camera, points)
        return self._weight(distance), gain

    def _weight(self, distance: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        return (2 - 2 * distance / self.margin).clamp(0, 1)


class Outline(NamedTuple):
    """The masks that bound an object."""

    silhouettes: tuple[Silhouette, ...]
    mirrored: tuple[bool, ...]  # True: the silhouette also bounds mirrored points
    strength: float  # strength of the gain, 0..1
    edits: tuple[Edit, ...] = ()  # of the object that was fitted to the photos

    def factor(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return the factor on the density of points: their weight in all masks, and the largest gain."""
        return self.factor_at(kinds.origins(points, self.edits))

    def factor_at(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Return :meth:`factor` of places on the fitted object."""
        weight = gain = torch.ones_like(points[..., 0])
        for silhouette, mirrored in zip(self.silhouettes, self.mirrored, strict=True):
            for position in (points, _mirror(points)) if mirrored else (points,):
                weight_here, gain_here = silhouette.weight_and_gain(position)
                weight = weight * weight_here
                gain = torch.maximum(gain, gain_here)
        return weight * (1 + self.strength * (gain - 1))


def outline(instance: Instance) -> Outline | None:
    """Return the outline that bounds an object; None without photo detail, or if no photo bounds it.

    Margins widen without limit as photo detail fades, and gains shrink, so the outline vanishes with it.
    """
    strength = effective_strength(instance)
    detail = instance.detail
    if not strength or detail is None:
        return None
    fitted = instance.fitted
    bounding = [Silhouette(view, view.outline_margin, fitted) for view in detail.views if view.outline_margin]
    mirrors = detail.other_side != "model"
    mirrored = tuple(mirrors and coherence(silhouette) >= _SYMMETRIC_ABOVE for silhouette in bounding)
    widened = tuple(silhouette._replace(margin=silhouette.margin / strength) for silhouette in bounding)
    return Outline(widened, mirrored, strength, edits_to_fitted(instance)) if bounding else None


@lru_cache(maxsize=16)
def coherence(silhouette: Silhouette) -> float:
    """Return the fraction of the mask whose rays cross the mirrored mask within the scene's box.

    1 for a symmetric object and the right camera.
    """
    camera, _ = _distances(silhouette.view)
    wide = max(1, round(_COHERENCE_SAMPLES * camera.width / camera.height))
    rays = camera_rays(camera.resized(wide, _COHERENCE_SAMPLES), torch.tensor(silhouette.fitted.model.extent))
    points = ray_points(rays, midpoints(uniform_edges(rays, _COHERENCE_SAMPLES)))
    on_mask = silhouette.weight(points.select(-2, _COHERENCE_SAMPLES // 2)) == 1
    crossed = (silhouette.weight(_mirror(points)) > 0).any(-1)
    return float((on_mask & crossed).sum() / on_mask.sum().clamp_min(1))


@lru_cache(maxsize=16)
def _distances(view: PhotoView) -> tuple[Camera, Float[Tensor, "1 1 rows columns"]]:
    """Return the camera and the values of a map: focal lengths from each pixel to a photo's mask, 0 on the mask."""
    from scipy.ndimage import distance_transform_edt

    width = max(1, round(_HEIGHT * view.camera.width / view.camera.height))
    opacity = torch.from_numpy(view.pixels()[None, ..., 3].copy()).float() / 255
    background = functional.adaptive_avg_pool2d(opacity, (_HEIGHT, width))[0].numpy() < BACKGROUND
    outside = np.pad(background, _PADDING, constant_values=True)
    camera = view.camera.resized(width, _HEIGHT)
    camera = replace(camera, width=width + 2 * _PADDING, height=_HEIGHT + 2 * _PADDING)
    with usual_settings():  # cached
        distance = torch.from_numpy(distance_transform_edt(outside).astype(np.float32))
        return camera, ((distance - 0.5).clamp_min(0) / camera.focal)[None, None]  # the edge lies between pixels


@lru_cache(maxsize=16)
@torch.no_grad()
def _distances_and_gains(fitted: Instance, view: PhotoView) -> Float[Tensor, "1 channels rows columns"]:
    """Return the map of distances, and beside it the gain at each pixel: 1 off the mask."""
    camera, distances = _distances(view)
    small = camera.resized(max(1, round(_GAIN_HEIGHT * camera.width / camera.height)), _GAIN_HEIGHT)
    on_mask = functional.adaptive_avg_pool2d((distances == 0).float(), (small.height, small.width))[0, 0] > 0.5
    gains = torch.ones(1, 1, *on_mask.shape)
    gains[0, 0, on_mask] = (_OPAQUE / _optical_depth(fitted, small, on_mask)).clamp(1, _MAX_GAIN)
    with usual_settings():  # cached
        return torch.cat((distances, functional.interpolate(gains, distances.shape[2:], mode="bilinear")), 1)


def _optical_depth(fitted: Instance, camera: Camera, pixels: Bool[Tensor, "rows columns"]) -> Float[Tensor, "rays"]:
    """Return the optical depth of a shape along the rays of the marked pixels, above 0."""
    model = with_network(fitted.model, fitted.codes)
    rays = camera_rays(camera, model.extent_tensor)[pixels.to(model.device)]
    edges = uniform_edges(rays, _GAIN_SAMPLES)
    bias = fitted.biases[0][None]
    points = ray_points(rays, midpoints(edges)).flatten(0, 1)
    density = batch_density(model, points[None], bias, shape_cells(model, bias)).reshape(-1, _GAIN_SAMPLES)
    return (density * edges.diff()).sum(-1).cpu().clamp_min(1e-6)


def _look_up(
    values: Float[Tensor, "1 channels rows columns"], camera: Camera, points: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "channels *batch"]:
    """Return the interpolated values of an image at the projections of points; beyond its edge, those of the edge."""
    local = camera.to_camera_axes(points)
    scale = 2 * camera.focal / (-local[..., 2]).clamp_min(1e-6)
    position = torch.stack((local[..., 0] * scale / camera.width, -local[..., 1] * scale / camera.height), -1)
    sampled = functional.grid_sample(
        values.to(points.device), position.reshape(1, 1, -1, 2), padding_mode="border", align_corners=False
    )
    return sampled.reshape(values.shape[1], *points.shape[:-1])


def _mirror(points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    return points * points.new_tensor([-1.0, 1.0, 1.0])
