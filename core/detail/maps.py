"""Compute photo detail (:class:`core.detail.lookup.DetailMaps`) from a photo and the codes fitted to it.

The object is rendered once from the photo's camera. The photo's colours, in the paint of the current texture
(:mod:`core.detail.repaint`), replace those of the surface. Their weight is 1 where photo and render both show a surface
that is not seen too flatly. It fades to 0 towards edges of the mask, jumps in depth, and places where the outlines of
photo and render disagree: there the shape differs, not the paint.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor
from torch.nn import functional

from core.detail.borrowed import BorrowedEnd, borrowed_ends
from core.detail.filters import blurred, continued, distance, enlarged, levels, resized
from core.detail.lettering import flanks, lettering, with_lamps, without_lettering
from core.detail.lookup import ColourMatch, DetailMaps, PhotoMaps, packed, smooth_step
from core.detail.mixture import PhotoPaints, photo_paints
from core.detail.repaint import colour_match, moved_paint, repainted
from core.detail.surface import SOLID, SurfaceTexels, surface_colours, surface_normals, surface_texels
from core.edits.paint import MATERIALS, UNPAINTED, PartPaint
from core.geometry.camera import Camera
from core.geometry.pixels import lightness
from core.geometry.rays import camera_rays
from core.models.model import Instance
from core.models.motion import edits_to_fitted
from core.models.photo_detail import PhotoView
from core.rendering.images import render_steps
from core.rendering.outline import effective_strength
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, Cached, CacheKind

SOURCE_SIZE = 256  # px across the render compared with the photo; lengths in px below refer to it
_SAMPLES = 192
_FADE = 10.0  # px from an edge over which the weight grows to 1
_SHAPE_FADE = 12.0  # px likewise, from disagreeing outlines, which may lie amid a smooth surface
_REACH = 8.0  # px beyond the photo's mask up to which its colours are extrapolated
_DEEP = 200  # outlines are noisy: colours are extrapolated from side/200 inside, or from the middle of thin parts
_LEAP = 0.02  # scene units of the second difference of depth at an edge of a nearer surface; slopes have none
_DISAGREEMENT = 4.0  # px by which outlines differ at most (2 at the size of the training images)
_UPWARD = 0.6, 0.85  # cosine of the normal with the vertical
_DARKER = 0.12, 0.3  # how much darker a photo is than the render on a roof: reflections, and glass
_TRUSTED = 0.05  # weight of paint that replaces lettering


def detail_maps(instance: Instance) -> Generator[None, None, DetailMaps | None]:
    """Return the photo detail of codes in the paint of their texture; None if there is none to show.

    Yields None many times on the first call, while photos are compared with their renders; the comparison is cached.
    """
    strength = effective_strength(instance)
    if not strength:
        return None
    detail = instance.detail
    assert detail is not None
    photos = yield from compared_photos(instance)
    ends = yield from _ends(instance, photos)
    key = tuple(photos), ends, instance.codes.texture_key
    maps, match = yield from CACHE.kept(CacheKind.DETAIL, key, _painted_maps(photos, ends, instance))
    space = edits_to_fitted(instance), instance.codes.proportions
    return DetailMaps(maps, strength, detail.other_side, match, *space, len(ends))


def _ends(instance: Instance, photos: list["ComparedPhoto"]) -> Generator[None, None, tuple[BorrowedEnd, ...]]:
    """Return the ends borrowed from a training object, for the mirrored side only; cached."""
    if instance.detail is None or instance.detail.other_side != "mirrored":
        return ()
    ends = borrowed_ends(instance.fitted, [photo.coverage for photo in photos])
    return (yield from CACHE.kept(CacheKind.DETAIL, ("ends", *photos), ends))


def compared_photos(instance: Instance) -> Generator[None, None, list["ComparedPhoto"]]:
    """Compare an object's photos with their renders; cached. Yields None many times on the first call."""
    photos = []
    fitted = instance.fitted
    for view in instance.detail.views if instance.detail else ():
        key = fitted.model, fitted, view
        photos.append((yield from CACHE.kept(CacheKind.DETAIL, key, compare_photo(fitted, view))))
    return photos


@dataclass(frozen=True, eq=False)
class ComparedPhoto(Cached):
    """A photo and the render of the codes fitted to it, from the photo's camera. Not modified after creation."""

    camera: Camera  # at the size of the render
    fitted: Instance  # to the photo
    photo: Float[Tensor, "3 height width"]  # the object's colours, extrapolated beyond its outline
    render: Float[Tensor, "3 h w"]  # the surface's colours, extrapolated likewise
    weight: Float[Tensor, "h w"]  # 0..1, reliability of the photo's colours
    near: Float[Tensor, "h w"]  # 0..1, zero far beyond the photo's outline
    paints: PhotoPaints
    lettering: Float[Tensor, "h w"]  # 1 where a mirror image would be unreadable, else 0
    surface: Float[Tensor, "4 h w"]  # as :attr:`core.detail.lookup.PhotoMaps.surface`
    texels: SurfaceTexels
    match: ColourMatch  # from the render's colours to the photo's

    @property
    def coverage(self) -> PhotoMaps:
        """Maps of the places that the photo shows, in the render's colours."""
        fine = (torch.cat((self.render, packed(self.weight, self.near)[None])),)
        return PhotoMaps(self.camera, fine, fine, self.surface)

    def change(self, textured: Instance) -> Float[Tensor, "3 h w"]:
        """Return the change of the surface's colours with the texture of another object."""
        if textured.codes.texture_key == self.fitted.codes.texture_key:
            return torch.zeros_like(self.render)
        return self.texels.colours(textured) - self.texels.colours(self.fitted)

    def painted(self, textured: Instance) -> Float[Tensor, "3 height width"]:
        """Return the photo in the texture and the edits of the texture of another object.

        The paint of a part changes like the mean of the render there; everything else keeps the photo's colour.
        """
        change = self.change(textured.unpainted)
        photo = self.photo
        shares = dict(zip(self.paints.names, self.paints.shares.float(), strict=True))
        colours = dict(zip(self.paints.names, self.paints.colours, strict=True))
        for name in colours if change.any() else ():
            weight = resized(shares[name][None], self.weight)[0] * self.weight
            weight = weight / weight.sum().clamp_min(1e-6)
            unpainted, change_mean = ((weight * image).sum((1, 2)) for image in (self.render, change))
            colour = colours[name]
            change_mean = moved_paint(change_mean, colour - unpainted)
            colours[name] = colour + change_mean
            if name not in (*UNPAINTED, *MATERIALS):
                repaint = repainted(self.photo, colour[:, None, None], change_mean[:, None, None])
                photo = photo + shares[name] * (repaint - self.photo)

        below = photo
        for paint in textured.codes.of_kind(PartPaint):
            unpainted, colour = (torch.tensor(values) for values in (paint.before, paint.colour))
            present = colours.get(paint.part, unpainted)
            change_mean = moved_paint(colour - unpainted, present - unpainted)
            painted = repainted(photo, present[:, None, None], change_mean[:, None, None]).clamp(0, 1)
            below = torch.lerp(below, painted, paint.share * paint.membership_in_photo(shares))
        return below


def compare_photo(fitted: Instance, view: PhotoView) -> Generator[None, None, ComparedPhoto]:
    """Render the fitted object from a photo's camera and weight the photo; yields None many times."""
    rgba = view.pixels().astype(np.float32) / 255
    high = SOURCE_SIZE
    camera = view.camera.resized(max(1, round(high * view.camera.width / view.camera.height)), high)
    source = yield from render_steps(fitted, camera, _SAMPLES)
    yield None
    with torch.inference_mode():
        source = Rendered(source.colour.cpu(), source.depth.cpu(), source.opacity.cpu())
        rays = camera_rays(camera, torch.tensor(fitted.model.extent))
        normals = surface_normals(rays, source)
        mask = resized(torch.from_numpy(rgba[None, ..., 3].copy()), source.opacity)[0]
        not_erased = smooth_step(
            distance(torch.from_numpy(view.kept(camera.width, high)), beyond=True), 0.0, _SHAPE_FADE
        )
        photo = _object_colours(rgba)
        render = surface_colours(source)
        surface = torch.cat((normals, source.depth[..., None]), -1).movedim(-1, 0)
        surface = continued(surface, source.opacity > 0.5)
        texels, parts = surface_texels(fitted, rays, source)
    yield None
    with torch.inference_mode():
        small = resized(photo, source.opacity)
        weight = not_erased * paint_weight(mask, source)
        near = not_erased * smooth_step(distance(mask < 0.5), _REACH, 0.5)
        match = colour_match(render.flatten(1), small.flatten(1), weight.flatten())
        roof = smooth_step(normals[..., 2], *_UPWARD) * (1 - parts.get("glass", torch.ones_like(mask)))
        # Where the photo is darker than a roof or bonnet, a small error of shape displaces the glass.
        weight = weight * (1 - roof * smooth_step(lightness(render) - lightness(small), *_DARKER))
        everywhere = {name: continued(part[None], texels.pixel)[0] for name, part in parts.items()}
        paints = photo_paints(photo, with_lamps(everywhere, small, normals), weight)
        body = paints.on_body(weight) & (weight > _TRUSTED)
        letters = lettering(photo, continued(small, body), flanks(parts, normals, weight))
    return ComparedPhoto(camera, fitted, photo, render, weight, near, paints, letters, surface, texels, match)


def _painted_maps(
    photos: Sequence[ComparedPhoto], ends: Sequence[BorrowedEnd], textured: Instance
) -> Generator[None, None, tuple[tuple[PhotoMaps, ...], ColourMatch]]:
    """Return the maps of photos and borrowed ends in a texture, and its match to the photos; yields None once."""
    maps = []
    colours = []
    paints = []
    weights = []
    yield None
    with torch.inference_mode():
        for compared in photos:
            change = compared.change(textured)
            photo = compared.painted(textured)
            weight, near = enlarged(torch.stack((compared.weight, compared.near)), photo)
            fine = torch.cat((photo, packed(weight, near)[None]))
            maps.append(_photo_maps(compared, fine, textured.model.device))
            colours.append((compared.render + change).flatten(1))
            paints.append(resized(photo, compared.weight).flatten(1))
            weights.append(compared.weight.flatten())
        match = colour_match(torch.cat(colours, 1), torch.cat(paints, 1), torch.cat(weights))
        return (*maps, *(end.maps(textured, match) for end in ends)), match


def _photo_maps(compared: ComparedPhoto, fine: Float[Tensor, "4 height width"], device: torch.device) -> PhotoMaps:
    """Return the photo at all sizes, and its mirror image with paint in place of lettering."""
    direct = mirrored = levels(fine, device)
    if bool(compared.lettering.any()):
        small = resized(fine[:3], compared.weight)
        paint = compared.paints.on_body(compared.weight) & (compared.weight > _TRUSTED)
        clean, replaced = without_lettering(small, compared.lettering, paint)
        clean = torch.lerp(fine[:3], enlarged(clean, fine[:3]), enlarged(replaced[None], fine[:3]))
        mirrored = levels(torch.cat((clean, fine[3:])), device)
    return PhotoMaps(compared.camera, direct, mirrored, compared.surface.to(device).contiguous())


def paint_weight(mask: Float[Tensor, "h w"], source: Rendered) -> Float[Tensor, "h w"]:
    """Return the weight, 0..1, by which photo and render differ in paint rather than in shape."""
    photo = mask > 0.5
    render = source.opacity > 0.5
    inside = photo & render & ~_leaps(source.depth)
    thick = distance(photo ^ render) > _DISAGREEMENT / 2  # the core of regions wider than that
    shape = smooth_step(distance(~thick, beyond=True), 2 * _DISAGREEMENT, 2 * _DISAGREEMENT + _SHAPE_FADE)
    return shape * smooth_step(distance(inside), 0.0, _FADE)


def _leaps(depth: Float[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
    """Mark pixels beside depth edges."""
    padded = functional.pad(depth[None, None], (1,) * 4, mode="replicate")[0, 0]
    sideways = padded[1:-1, 2:] - 2 * depth + padded[1:-1, :-2]
    down = padded[2:, 1:-1] - 2 * depth + padded[:-2, 1:-1]
    return torch.maximum(sideways.abs(), down.abs()) > _LEAP


def _object_colours(rgba: Float32[np.ndarray, "height width 4"]) -> Float[Tensor, "3 height width"]:
    """Return the photo without the background's light, extrapolated beyond its outline."""
    opacity = torch.from_numpy(rgba[..., 3:]).movedim(-1, 0)
    photo = torch.from_numpy(rgba[..., :3]).movedim(-1, 0)
    photo = ((photo - (1 - opacity)) / opacity.clamp_min(1e-3)).clamp(0, 1)
    solid = opacity[0] > SOLID
    depth = len(rgba) / _DEEP
    core = _core(solid, depth)
    return torch.where(core, photo, blurred(continued(photo, core), depth))


def _core(mask: Bool[Tensor, "h w"], depth: float) -> Bool[Tensor, "h w"]:
    """Return the pixels of a mask at least ``depth`` px inside it, and the middle of narrower parts."""
    inside = distance(mask)
    reach = math.ceil(depth)
    deepest = functional.max_pool2d(inside[None], 2 * reach + 1, 1, reach)[0]
    return mask & (inside >= deepest.clamp_max(depth))
