"""From a photo and the codes fitted to it to what is added to colours (:class:`core.rendering.detail_maps.DetailMaps`).

The object is rendered once as the photo's camera sees it. Photo less render is the residual; its weight is 1 on what
both show, seen not too flatly, and fades to 0 towards edges: those of the mask, those where the depth leaps, and around
places where the outlines of photo and render disagree, which is shape and not paint.
"""

import math
from collections.abc import Generator

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor
from torch.nn import functional

from core.geometry.rays import camera_rays
from core.models.codes import Codes
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.detail_maps import DetailMaps, PhotoMaps, smooth_step
from core.rendering.fast import render_steps
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, Kind

SOURCE_SIZE = 256
"""px across of the render that the photo is compared with; all lengths in px below are of it"""
_SAMPLES = 192
_FADE = 10.0
"""px from an edge over which the weight grows to 1"""
_SHAPE_FADE = 12.0
"""px the same, from where outlines disagree, which may be in the middle of a smooth surface"""
_REACH = 8.0
"""px beyond the photo's mask up to which its colours go on"""
_SOLID = 0.9
"""opacity from which on a pixel has the object's colour, little background mixed in"""
_DEEP = 340
"""such part of a photo's side lies between its outline and the pixels whose colours go on beyond"""
_LEAP = 0.02
"""scene units of the second difference of depth, at an edge of something in front; a slope has none"""
_DISAGREEMENT = 4.0
"""px by which outlines differ at the most (2 at the size of the training images)"""
MIRROR_SHARE = 0.9
"""of the residual, for what only the mirror image shows"""
_MIRROR_BLUR = 2.0
"""px, standard deviation: light is not symmetric, and lettering would be read backwards"""
_UNSURE, _SURE = 0.5, 0.7
"""confidence in the camera below which nothing is shown, and from which on all of it is"""
FADED = 1.5
"""standard deviations that the codes have moved, when nothing is left"""
_LEVELS = 6


def shown_share(model: Model, codes: Codes) -> float:
    """How much of their detail codes show: of the strength, less for a doubtful camera, fading as codes are edited."""
    detail = codes.detail
    if detail is None or model.white_from_network or model.is_ablation:
        return 0.0
    spaces = model.codes.shape_space, model.codes.texture_space
    pairs = (codes.shape, detail.shape), (codes.texture, detail.texture)
    away = [float(space.distance(new, old)) for space, (new, old) in zip(spaces, pairs, strict=True)]
    sure = min(1.0, max(0.0, (detail.confidence - _UNSURE) / (_SURE - _UNSURE)))
    return detail.strength * sure * math.prod(max(0.0, 1 - distance / FADED) for distance in away)


def detail_maps(model: Model, codes: Codes) -> Generator[None, None, DetailMaps | None]:
    """What the photo of codes adds to colours; None where there is none, or nothing of it is to be seen.

    Yields None many times while the source is rendered, the first time; it is kept.
    """
    share = shown_share(model, codes)
    if not share:
        return None
    detail = codes.detail
    assert detail is not None
    photos = []
    for view in detail.views:
        key = model, view, detail.codes_key
        known: PhotoMaps | None = CACHE.get(Kind.DETAIL, key)
        if known is None:
            known = yield from make_maps(model, detail, view)
            CACHE.put(Kind.DETAIL, key, known, known.size)
        photos.append(known)
    return DetailMaps(tuple(photos), share, detail.both_sides)


def make_maps(model: Model, detail: PhotoDetail, view: PhotoView) -> Generator[None, None, PhotoMaps]:
    """The maps of one photo; yields None many times."""
    rgba = view.pixels().astype(np.float32) / 255
    high = SOURCE_SIZE
    camera = view.camera.resized(max(1, round(high * view.camera.width / view.camera.height)), high)
    codes = Codes(detail.shape.to(model.device), detail.texture.to(model.device))
    source = yield from render_steps(model, codes, camera, _SAMPLES)
    yield None
    with torch.inference_mode():
        source = Rendered(source.colour.cpu(), source.depth.cpu(), source.opacity.cpu())
        rays = camera_rays(camera, torch.tensor(model.extent))
        normals = surface_normals(rays.origins, rays.directions, source)
        mask = _small(rgba[..., 3], source)
        kept = smooth_step(_distance(torch.from_numpy(view.kept(camera.width, high)), beyond=True), 0.0, _SHAPE_FADE)
        fine = _residual(rgba, source, kept * paint_weight(mask, source), kept * near_weight(mask))
        levels = [fine]
        while len(levels) < _LEVELS and min(levels[-1].shape[1:]) > 32:
            levels.append(functional.avg_pool2d(levels[-1][None], 2, ceil_mode=True, count_include_pad=False)[0])
        small = functional.adaptive_avg_pool2d(fine[None], (high, camera.width))[0]
        soft = _blurred(torch.cat((small[:3] * small[3:], small[3:])), _MIRROR_BLUR)
        soft = torch.cat((soft[:3] / soft[3:].clamp_min(1e-3), MIRROR_SHARE * soft[3:]))
        surface = torch.cat((normals, source.depth[..., None]), -1).movedim(-1, 0)
        surface = _continued(surface, source.opacity > 0.5)
        *parts, soft, surface = (part.to(model.device).contiguous() for part in (*levels, soft, surface))
    return PhotoMaps(camera, tuple(parts), soft, surface)


def surface_normals(
    origins: Float[Tensor, "h w 3"], directions: Float[Tensor, "h w 3"], rendered: Rendered
) -> Float[Tensor, "h w 3"]:
    """Unit normals towards the camera, from a depth that is smoothed a little."""
    opacity = rendered.opacity.clamp_min(1e-6)
    depth = _blurred((rendered.depth * opacity)[None], 1.5)[0] / _blurred(opacity[None], 1.5)[0].clamp_min(1e-6)
    points = origins + directions * depth[..., None]
    padded = functional.pad(points.movedim(-1, 0)[None], (1,) * 4, mode="replicate")[0]
    across, down = padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2], padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]
    normal = functional.normalize(torch.linalg.cross(across, down, dim=0).movedim(0, -1), dim=-1)
    return torch.where((normal * directions).sum(-1, keepdim=True) > 0, -normal, normal)


def paint_weight(mask: Float[Tensor, "h w"], source: Rendered) -> Float[Tensor, "h w"]:
    """0..1: where the residual is paint."""
    photo, render = mask > 0.5, source.opacity > 0.5
    inside = photo & render & ~_leaps(source.depth)
    thick = _distance(photo ^ render) > _DISAGREEMENT / 2  # the middle of what is wider than that
    shape = smooth_step(_distance(~thick, beyond=True), 2 * _DISAGREEMENT, 2 * _DISAGREEMENT + _SHAPE_FADE)
    return shape * smooth_step(_distance(inside), 0.0, _FADE)


def _leaps(depth: Float[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
    """Beside edges of what lies in front of something else."""
    padded = functional.pad(depth[None, None], (1,) * 4, mode="replicate")[0, 0]
    across = padded[1:-1, 2:] - 2 * depth + padded[1:-1, :-2]
    down = padded[2:, 1:-1] - 2 * depth + padded[:-2, 1:-1]
    return torch.maximum(across.abs(), down.abs()) > _LEAP


def _distance(mask: Bool[Tensor, "h w"], beyond: bool = False) -> Float[Tensor, "h w"]:
    """px from each pixel of a mask to the nearest that is none.

    Args:
        beyond: whether the mask goes on beyond the image.
    """
    from scipy.ndimage import distance_transform_edt

    if beyond and bool(mask.all()):
        return torch.full(mask.shape, torch.inf)
    padded = np.pad(mask.numpy(), 1, constant_values=beyond)
    return torch.from_numpy(distance_transform_edt(padded)[1:-1, 1:-1].astype(np.float32))


def near_weight(mask: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """0..1: how much of the residual is left; none far beyond the photo's mask."""
    return smooth_step(_distance(mask < 0.5), _REACH, 0.5)


def _residual(
    rgba: Float32[np.ndarray, "height width 4"],
    source: Rendered,
    weight: Float[Tensor, "h w"],
    near: Float[Tensor, "h w"],
) -> Float[Tensor, "4 height width"]:
    """Colour of the object in the photo less that of the surface, and the weight, at the photo's size: the render is
    smooth, and what is finer is the photo's own. Both go on beyond their edges, where a pixel is partly background.
    """
    light = (1 - source.opacity)[..., None]
    surface = ((source.colour - light) / (1 - light).clamp_min(1e-3)).clamp(0, 1).movedim(-1, 0)
    surface = _continued(surface, source.opacity > _SOLID)
    small = torch.cat((surface, torch.stack((weight, near, light[..., 0]))))[None]
    large = functional.interpolate(small, rgba.shape[:2], mode="bilinear", align_corners=False)[0]
    opacity = torch.from_numpy(rgba[..., 3:]).movedim(-1, 0)
    photo = torch.from_numpy(rgba[..., :3]).movedim(-1, 0)
    # What makes the render's pixel the photo's: at an outline both are partly background. In a finer photo than the
    # render these pixels are a thin line, which would be seen.
    exact = ((photo - large[5:]) / (1 - large[5:]).clamp_min(0.1)).clamp(0, 1)
    mixed = (opacity > 0.5) & (large[5:] < 0.9) if len(rgba) <= SOURCE_SIZE else torch.zeros_like(opacity).bool()
    photo = ((photo - (1 - opacity)) / opacity.clamp_min(1e-3)).clamp(0, 1)
    solid = opacity[0] > _SOLID
    deep = solid & (_distance(solid) > len(rgba) / _DEEP)  # a photo's outline is noisy
    photo = torch.where(solid, photo, _continued(photo, deep if bool(deep.any()) else solid))
    photo = torch.where(mixed, exact, photo)
    return torch.cat(((photo - large[:3]) * large[4:5], large[3:4]))


def _continued(image: Float[Tensor, "channels h w"], known: Bool[Tensor, "h w"]) -> Float[Tensor, "channels h w"]:
    """With the nearest known value everywhere else."""
    from scipy.ndimage import distance_transform_edt

    if not bool(known.any()):
        return image
    rows, columns = distance_transform_edt(~known.numpy(), return_distances=False, return_indices=True)
    return image[:, torch.from_numpy(rows).long(), torch.from_numpy(columns).long()]


def _small(image: Float32[np.ndarray, "height width"], source: Rendered) -> Float[Tensor, "h w"]:
    rows, columns = source.opacity.shape
    large = torch.from_numpy(np.ascontiguousarray(image))
    return functional.adaptive_avg_pool2d(large[None], (rows, columns))[0]


def _blurred(image: Float[Tensor, "channels h w"], deviation: float) -> Float[Tensor, "channels h w"]:
    """By a Gaussian, px; what lies beyond the image counts as its border."""
    half = math.ceil(3 * deviation)
    kernel = torch.exp(-((torch.arange(-half, half + 1) / deviation) ** 2) / 2)
    kernel = kernel / kernel.sum()
    padded = functional.pad(image[:, None], (half,) * 4, mode="replicate")
    return functional.conv2d(functional.conv2d(padded, kernel[None, None, None]), kernel[None, None, :, None])[:, 0]
