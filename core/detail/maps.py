"""Compute photo detail (:class:`core.rendering.detail_maps.DetailMaps`) from a photo and the codes fitted to it.

The object is rendered once from the photo's camera. The photo's colours, in the paint of the current texture
(:mod:`core.detail.repaint`), replace those of the surface. Their weight is 1 where photo and render both show a surface
that is not seen too flatly. It fades to 0 towards edges of the mask, jumps in depth, and places where the outlines of
photo and render disagree: there the shape differs, not the paint.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor
from torch.nn import functional

from core.detail.repaint import chroma, colour_match, light_share, lightness, moved_paint, repainted, same_hue
from core.geometry.camera import Camera
from core.geometry.rays import Rays, camera_rays
from core.models.codes import Codes
from core.models.model import Model
from core.models.photo_detail import PhotoDetail, PhotoView
from core.rendering.detail_maps import ColourMatch, DetailMaps, PhotoMaps, packed, smooth_step
from core.rendering.folded_field import FoldedField
from core.rendering.images import render_steps
from core.rendering.motion import warp_to_fitted
from core.rendering.outline import shown_share
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, CacheKind
from core.runtime.pool import map_pieces

SOURCE_SIZE = 256  # px across the render compared with the photo; lengths in px below refer to it
_SAMPLES = 192
_FADE = 10.0  # px from an edge over which the weight grows to 1
_SHAPE_FADE = 12.0  # px likewise, from disagreeing outlines, which may lie amid a smooth surface
_REACH = 8.0  # px beyond the photo's mask up to which its colours are extrapolated
_SOLID = 0.9  # opacity from which a pixel has the object's colour, with little background mixed in
_DEEP = 200  # outlines are noisy: colours are extrapolated from side/200 inside, or from the middle of thin parts
_LEAP = 0.02  # scene units of the second difference of depth at an edge of a nearer surface; slopes have none
_DISAGREEMENT = 4.0  # px by which outlines differ at most (2 at the size of the training images)
MIRROR_SHARE = 0.9  # weight of the residual at places that only the mirror image shows
_MIRROR_BLUR = 2.0  # px, standard deviation: light is not symmetric, and lettering would be mirrored
_LEVELS = 6
UNPAINTED = "wheels", "glass"
_PAINTED = 0.35, 0.6  # change of the render, relative to the main paint's: no paint below, only paint above
_OTHER = 4.0, 2.0  # the same of another material, such as the wood of a chair, and of the main paint
_UNCHANGED = 0.05  # change of the main paint below which there is hardly any
_ROUGH = 4.0  # change taken off for contrast of 1 in the photo: lamps and grilles change like shaded paint
_CALM = 0.055, 0.035  # contrast of lamps and grilles, and of plain paint
_WINDOW = 1.0, 5  # px, standard deviation and reach of the windows in which contrast is measured
_VIVID = 0.15, 0.35  # chroma over lightness: greys stay below the first; no tyre or pane reaches the second
_LIT = 0.15, 0.35  # lightness over a vivid paint's; darker is a gap of any hue
_GREY_LIT = 0.35, 0.6  # the same for white and grey paint, which trim and grilles share
_FRAME = 0.5, 0.7  # lightness over the paint's, of window frames: panes are darker
_BESIDE = 4.0  # px, standard deviation: distance of a window's frame from the body
_AROUND = 8.0, 0.05, 0.2  # px, and the share of the main paint within it from which there is no other paint
_UPWARD = 0.6, 0.85  # cosine of the normal with the vertical
_DARKER = 0.12, 0.3  # how much darker a photo is than the render on a roof: reflections, and glass
_BLOCK = 4096  # points that a thread evaluates at a time


def detail_maps(model: Model, codes: Codes) -> Generator[None, None, DetailMaps | None]:
    """Return the photo detail of codes in the paint of their texture; None if there is none to show.

    Yields None many times on the first call, while photos are compared with their renders; the comparison is cached.
    """
    share = shown_share(model, codes)
    if not share:
        return None
    detail = codes.detail
    assert detail is not None
    photos = yield from compared_photos(model, detail)
    key = tuple(photos), codes.texture_key
    known: tuple[tuple[PhotoMaps, ...], ColourMatch] | None = CACHE.get(CacheKind.DETAIL, key)
    if known is None:
        yield None
        with torch.inference_mode():
            known = _painted_maps(model, photos, codes)
        CACHE.put(CacheKind.DETAIL, key, known, sum(photo.size for photo in known[0]))
    return DetailMaps(known[0], share, detail.other_side, known[1], warp_to_fitted(model, detail.fitted, codes))


def compared_photos(model: Model, detail: PhotoDetail) -> Generator[None, None, list["ComparedPhoto"]]:
    """Compare the photos with their renders; cached. Yields None many times on the first call."""
    photos = []
    for view in detail.views:
        key = model, view, detail.fitted
        known: ComparedPhoto | None = CACHE.get(CacheKind.DETAIL, key)
        if known is None:
            known = yield from compare_photo(model, detail, view)
            CACHE.put(CacheKind.DETAIL, key, known, known.size)
        photos.append(known)
    return photos


@dataclass(frozen=True, eq=False)
class ComparedPhoto:
    """A photo and the render of the codes fitted to it, from the photo's camera. Not modified after creation."""

    camera: Camera  # at the size of the render
    codes: Codes  # fitted to the photo
    photo: Float[Tensor, "3 height width"]  # the object's colours, extrapolated beyond its outline
    render: Float[Tensor, "3 h w"]  # the surface's colours, extrapolated likewise
    weight: Float[Tensor, "h w"]  # 0..1, reliability of the photo's colours
    near: Float[Tensor, "h w"]  # 0..1, zero far beyond the photo's outline
    body: Float[Tensor, "h w"]  # 0..1, zero on wheels and panes
    rough: Float[Tensor, "h w"]  # contrast of the photo's lightness, 0..1
    alike: Float[Tensor, "h w"]  # 0..1, similarity to the main paint
    surface: Float[Tensor, "4 h w"]  # as :attr:`core.rendering.detail_maps.PhotoMaps.surface`
    texels: "SurfaceTexels"
    match: ColourMatch  # from the render's colours to the photo's

    def change(self, model: Model, textured: Codes) -> Float[Tensor, "3 h w"]:
        """Return the change of the surface's colours with the texture of other codes."""
        if textured.texture_key == self.codes.texture_key:
            return torch.zeros_like(self.render)
        return self.texels.colours(model, textured) - self.texels.colours(model, self.codes)

    def repainted(self, change: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 height width"]:
        """Return the photo repainted, given the change of the render.

        Paint is where that changes like the main paint and the photo is calm, unlike in lamps and a grille, and where
        the photo has the main paint's colour. Around such places it changes evenly: a texture is never quite even.
        """
        offset = self.match.change(self.render.movedim(0, -1)).movedim(-1, 0)
        certain = self.alike * self.weight
        photo, render, even = (
            (certain * image).sum((1, 2), keepdim=True) / certain.sum().clamp_min(1e-6)
            for image in (_resized(self.photo, certain), self.render, change)
        )
        reach, least, enough = _AROUND
        strength = change.abs().amax(0) / even.abs().amax().clamp_min(_UNCHANGED)
        main = smooth_step(_blurred(certain[None], reach), least, enough) * smooth_step(strength, *_OTHER)
        paint = torch.lerp(self.render + offset, photo, main)
        moved = torch.lerp(moved_paint(change, offset), moved_paint(even, photo - render), main)
        known = self.body * smooth_step(strength - _ROUGH * self.rough, *_PAINTED)
        painted = torch.maximum(known, self.alike)
        colour, moved, painted = _enlarged(torch.cat((paint, moved, painted[None])), self.photo).split((3, 3, 1))
        return repainted(self.photo, colour, moved, painted[0])

    @property
    def size(self) -> int:
        """bytes"""
        maps = (part for part in vars(self).values() if isinstance(part, Tensor))
        return sum(part.nbytes for part in (*maps, self.texels.features))


class SurfaceTexels(NamedTuple):
    """The opaque pixels of a render, with everything a texture needs to colour their surface."""

    pixel: Bool[Tensor, "h w"]
    features: Float[Tensor, "pixels width"]
    direction_bias: Float[Tensor, "pixels width"]

    def colours(self, model: Model, codes: Codes) -> Float[Tensor, "3 h w"]:
        """Return the colours of the surface in a texture, extrapolated beyond the opaque pixels."""
        folded, image = FoldedField(model, codes), torch.zeros(3, *self.pixel.shape)
        blocks = zip(self.features.split(_BLOCK), self.direction_bias.split(_BLOCK), strict=True)
        colours = map_pieces(lambda block: folded.colour(*block), blocks)
        image[:, self.pixel] = torch.cat(list(colours)).cpu().clamp(0, 1).T
        return _continued(image, self.pixel)


def compare_photo(model: Model, detail: PhotoDetail, view: PhotoView) -> Generator[None, None, ComparedPhoto]:
    """Render the fitted codes from a photo's camera and weight the photo; yields None many times."""
    rgba = view.pixels().astype(np.float32) / 255
    high = SOURCE_SIZE
    camera = view.camera.resized(max(1, round(high * view.camera.width / view.camera.height)), high)
    codes = Codes.of(detail.fitted)
    source = yield from render_steps(model, codes, camera, _SAMPLES)
    yield None
    with torch.inference_mode():
        source = Rendered(source.colour.cpu(), source.depth.cpu(), source.opacity.cpu())
        rays = camera_rays(camera, torch.tensor(model.extent))
        normals = surface_normals(rays.origins, rays.directions, source)
        mask = _resized(torch.from_numpy(rgba[None, ..., 3].copy()), source.opacity)[0]
        kept = smooth_step(_distance(torch.from_numpy(view.kept(camera.width, high)), beyond=True), 0.0, _SHAPE_FADE)
        photo, render = _object_colours(rgba), _surface_colours(source)
        surface = torch.cat((normals, source.depth[..., None]), -1).movedim(-1, 0)
        surface = _continued(surface, source.opacity > 0.5)
        texels, parts = _surface_texels(model, codes, rays, source)
    yield None
    with torch.inference_mode():
        small = _resized(photo, source.opacity)
        weight = kept * paint_weight(mask, source)
        near = kept * smooth_step(_distance(mask < 0.5), _REACH, 0.5)
        match = colour_match(render.flatten(1), small.flatten(1), weight.flatten())
        roof = smooth_step(normals[..., 2], *_UPWARD) * (1 - parts.get("glass", torch.ones_like(mask)))
        weight = weight * _without_glass_above(small, render, roof)
        paint = _paint_places(small, parts, weight)
    return ComparedPhoto(camera, codes, photo, render, weight, near, *paint, surface, texels, match)


def _surface_texels(
    model: Model, codes: Codes, rays: Rays, source: Rendered
) -> tuple[SurfaceTexels, dict[str, Float[Tensor, "h w"]]]:
    """Return the rendered surface and the probability of each of the model's parts there."""
    pixel, folded = source.opacity > _SOLID, FoldedField(model, codes)
    points = (rays.origins + rays.directions * source.depth[..., None])[pixel].to(folded.device)
    found = list(map_pieces(lambda part: folded.density(part)[1], points.split(_BLOCK)))
    features = torch.cat(found) if found else torch.zeros(0, model.field.config.width)
    texels = SurfaceTexels(pixel, features, folded.direction_bias(rays.directions[pixel].to(folded.device)))
    parts = dict[str, Tensor]()
    if model.part_head:
        for name, share in zip(model.part_head.names, model.part_head(features).cpu().T, strict=True):
            parts[name] = torch.zeros(pixel.shape)
            parts[name][pixel] = share
    return texels, parts


def _without_glass_above(
    photo: Float[Tensor, "3 h w"], render: Float[Tensor, "3 h w"], roof: Float[Tensor, "h w"]
) -> Float[Tensor, "h w"]:
    """Return 0 where the photo is darker than a roof or bonnet: glass, displaced by a small error of shape."""
    return 1 - roof * smooth_step(lightness(render) - lightness(photo), *_DARKER)


def _paint_places(
    photo: Float[Tensor, "3 h w"], parts: dict[str, Float[Tensor, "h w"]], weight: Float[Tensor, "h w"]
) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Return :attr:`ComparedPhoto.body`, ``rough`` and ``alike``.

    The main paint is the median colour of the body's calm places. A vivid one counts on any part, white or
    grey on calm places of the body and on window frames.
    """
    rough = _roughness(photo)
    body = 1 - sum((parts[name] for name in UNPAINTED if name in parts), torch.zeros_like(rough))
    certain = body * smooth_step(rough, *_CALM) * weight > 0.5
    if not bool(certain.any()):
        return body, rough, torch.zeros_like(body)
    paint = photo[:, certain].median(1).values[:, None, None]
    hue, light = same_hue(photo, paint), light_share(photo, paint)
    vivid = smooth_step(chroma(paint).abs().amax(0) / (0.3 + 0.7 * lightness(paint)), *_VIVID)
    alike = body * smooth_step(light, *_GREY_LIT) * smooth_step(rough, *_CALM)
    if "glass" in parts:
        beside = smooth_step(_blurred(body[None], _BESIDE)[0], 0.02, 0.2)  # no highlight amid a pane
        alike = torch.maximum(alike, beside * parts["glass"] * smooth_step(light, *_FRAME))
    alike = _blurred((hue * torch.maximum(alike, vivid * smooth_step(light, *_LIT)))[None], 1.0)[0]
    return body, rough, alike


def _roughness(image: Float[Tensor, "3 h w"]) -> Float[Tensor, "h w"]:
    """Return the standard deviation of lightness in the calmest of the windows around each pixel."""
    light, (deviation, reach) = lightness(image)[None], _WINDOW
    variance = _blurred(light**2, deviation) - _blurred(light, deviation) ** 2
    return -functional.max_pool2d(-variance.clamp_min(0).sqrt(), reach, 1, reach // 2)[0]


def _painted_maps(
    model: Model, photos: Sequence[ComparedPhoto], textured: Codes
) -> tuple[tuple[PhotoMaps, ...], ColourMatch]:
    """Return the maps of all photos in a texture, and the match of its colours to the photos."""
    maps, colours, shown, weights = [], [], [], []
    for one in photos:
        change = one.change(model, textured)
        photo = one.repainted(change) if change.any() else one.photo
        weight, near = _enlarged(torch.stack((one.weight, one.near)), photo)
        fine = torch.cat((photo, packed(weight, near)[None]))
        maps.append(_photo_maps(one, fine, one.render + change, model.device))
        colours.append((one.render + change).flatten(1))
        shown.append(_resized(photo, one.weight).flatten(1))
        weights.append(one.weight.flatten())
    return tuple(maps), colour_match(torch.cat(colours, 1), torch.cat(shown, 1), torch.cat(weights))


def _photo_maps(
    one: ComparedPhoto, fine: Float[Tensor, "4 height width"], render: Float[Tensor, "3 h w"], device: torch.device
) -> PhotoMaps:
    """Return the photo at all sizes, and its low-passed difference from the render for a soft mirror image."""
    levels = [fine]
    while len(levels) < _LEVELS and min(levels[-1].shape[1:]) > 32:
        levels.append(functional.avg_pool2d(levels[-1][None], 2, ceil_mode=True, count_include_pad=False)[0])
    small = _resized(fine[:3], one.weight)
    soft = _blurred(torch.cat(((small - render) * one.weight, one.weight[None])), _MIRROR_BLUR)
    soft = torch.cat((soft[:3] / soft[3:].clamp_min(1e-3), MIRROR_SHARE * soft[3:]))
    *parts, soft, surface = (part.to(device).contiguous() for part in (*levels, soft, one.surface))
    return PhotoMaps(one.camera, tuple(parts), soft, surface)


def surface_normals(
    origins: Float[Tensor, "h w 3"], directions: Float[Tensor, "h w 3"], rendered: Rendered
) -> Float[Tensor, "h w 3"]:
    """Return unit normals towards the camera, from slightly smoothed depth."""
    opacity = rendered.opacity.clamp_min(1e-6)
    depth = _blurred((rendered.depth * opacity)[None], 1.5)[0] / _blurred(opacity[None], 1.5)[0].clamp_min(1e-6)
    points = origins + directions * depth[..., None]
    padded = functional.pad(points.movedim(-1, 0)[None], (1,) * 4, mode="replicate")[0]
    across, down = padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2], padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]
    normal = functional.normalize(torch.linalg.cross(across, down, dim=0).movedim(0, -1), dim=-1)
    return torch.where((normal * directions).sum(-1, keepdim=True) > 0, -normal, normal)


def paint_weight(mask: Float[Tensor, "h w"], source: Rendered) -> Float[Tensor, "h w"]:
    """Return the weight, 0..1, by which photo and render differ in paint rather than in shape."""
    photo, render = mask > 0.5, source.opacity > 0.5
    inside = photo & render & ~_leaps(source.depth)
    thick = _distance(photo ^ render) > _DISAGREEMENT / 2  # the core of regions wider than that
    shape = smooth_step(_distance(~thick, beyond=True), 2 * _DISAGREEMENT, 2 * _DISAGREEMENT + _SHAPE_FADE)
    return shape * smooth_step(_distance(inside), 0.0, _FADE)


def _leaps(depth: Float[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
    """Mark pixels beside depth edges."""
    padded = functional.pad(depth[None, None], (1,) * 4, mode="replicate")[0, 0]
    across = padded[1:-1, 2:] - 2 * depth + padded[1:-1, :-2]
    down = padded[2:, 1:-1] - 2 * depth + padded[:-2, 1:-1]
    return torch.maximum(across.abs(), down.abs()) > _LEAP


def _distance(mask: Bool[Tensor, "h w"], beyond: bool = False) -> Float[Tensor, "h w"]:
    """Return the distance in px from each pixel of a mask to the nearest pixel outside.

    Args:
        beyond: True: the mask continues beyond the image.
    """
    from scipy.ndimage import distance_transform_edt

    if beyond and bool(mask.all()):
        return torch.full(mask.shape, torch.inf)
    padded = np.pad(mask.numpy(), 1, constant_values=beyond)
    return torch.from_numpy(distance_transform_edt(padded)[1:-1, 1:-1].astype(np.float32))


def _surface_colours(source: Rendered) -> Float[Tensor, "3 h w"]:
    """Return the render without the background's light, extrapolated beyond the outline."""
    light = (1 - source.opacity)[..., None]
    surface = ((source.colour - light) / (1 - light).clamp_min(1e-3)).clamp(0, 1).movedim(-1, 0)
    return _continued(surface, source.opacity > _SOLID)


def _object_colours(rgba: Float32[np.ndarray, "height width 4"]) -> Float[Tensor, "3 height width"]:
    """Return the photo without the background's light, extrapolated beyond its outline."""
    opacity = torch.from_numpy(rgba[..., 3:]).movedim(-1, 0)
    photo = torch.from_numpy(rgba[..., :3]).movedim(-1, 0)
    photo = ((photo - (1 - opacity)) / opacity.clamp_min(1e-3)).clamp(0, 1)
    solid = opacity[0] > _SOLID
    depth = len(rgba) / _DEEP
    core = _core(solid, depth)
    return torch.where(core, photo, _blurred(_continued(photo, core), depth))


def _core(mask: Bool[Tensor, "h w"], depth: float) -> Bool[Tensor, "h w"]:
    """Return the pixels of a mask at least ``depth`` px inside it, and the middle of narrower parts."""
    inside, reach = _distance(mask), math.ceil(depth)
    deepest = functional.max_pool2d(inside[None], 2 * reach + 1, 1, reach)[0]
    return mask & (inside >= deepest.clamp_max(depth))


def _continued(image: Float[Tensor, "channels h w"], known: Bool[Tensor, "h w"]) -> Float[Tensor, "channels h w"]:
    """Fill unknown pixels with the nearest known value."""
    from scipy.ndimage import distance_transform_edt

    if not bool(known.any()):
        return image
    rows, columns = distance_transform_edt(~known.numpy(), return_distances=False, return_indices=True)
    return image[:, torch.from_numpy(rows).long(), torch.from_numpy(columns).long()]


def _resized(
    image: Float[Tensor, "channels height width"], like: Float[Tensor, "h w"]
) -> Float[Tensor, "channels h w"]:
    """Average areas down to the size of another image."""
    rows, columns = like.shape
    return functional.adaptive_avg_pool2d(image[None], (rows, columns))[0]


def _enlarged(
    image: Float[Tensor, "channels h w"], like: Float[Tensor, "3 height width"]
) -> Float[Tensor, "channels height width"]:
    """Interpolate bilinearly to the size of another image."""
    return functional.interpolate(image[None], like.shape[1:], mode="bilinear", align_corners=False)[0]


def _blurred(image: Float[Tensor, "channels h w"], deviation: float) -> Float[Tensor, "channels h w"]:
    """Blur by a Gaussian (px); borders are replicated."""
    half = math.ceil(3 * deviation)
    kernel = torch.exp(-((torch.arange(-half, half + 1) / deviation) ** 2) / 2)
    kernel = kernel / kernel.sum()
    padded = functional.pad(image[:, None], (half,) * 4, mode="replicate")
    return functional.conv2d(functional.conv2d(padded, kernel[None, None, None]), kernel[None, None, :, None])[:, 0]
