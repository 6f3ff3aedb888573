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
from core.detail.lettering import lettering, without_lettering
from core.detail.lookup import ColourMatch, DetailMaps, PhotoMaps, packed, smooth_step
from core.detail.repaint import chroma, colour_match, light_share, moved_paint, repainted, same_hue
from core.detail.surface import SOLID, SurfaceTexels, surface_colours, surface_normals, surface_texels
from core.edits.edit import Colour
from core.geometry.camera import Camera
from core.geometry.pixels import lightness
from core.geometry.rays import camera_rays
from core.models.model import Instance, Model
from core.models.motion import edits_to_fitted
from core.models.photo_detail import PhotoView
from core.rendering.images import render_steps
from core.rendering.outline import effective_strength
from core.rendering.reference import Rendered
from core.runtime.caches import CACHE, CacheKind

SOURCE_SIZE = 256  # px across the render compared with the photo; lengths in px below refer to it
_SAMPLES = 192
_FADE = 10.0  # px from an edge over which the weight grows to 1
_SHAPE_FADE = 12.0  # px likewise, from disagreeing outlines, which may lie amid a smooth surface
_REACH = 8.0  # px beyond the photo's mask up to which its colours are extrapolated
_DEEP = 200  # outlines are noisy: colours are extrapolated from side/200 inside, or from the middle of thin parts
_LEAP = 0.02  # scene units of the second difference of depth at an edge of a nearer surface; slopes have none
_DISAGREEMENT = 4.0  # px by which outlines differ at most (2 at the size of the training images)
UNPAINTED = "wheels", "glass"
_PAINTED = 0.35, 0.6  # change of the render, relative to the main paint's: no paint below, only paint above
_OTHER = 4.0, 2.0  # the same of another material, such as the wood of a chair, and of the main paint
_UNCHANGED = 0.05  # change of the main paint below which there is hardly any
_ROUGH = 7.0  # change taken off for contrast of 1 in the photo: lamps and grilles change like paint
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
_FLANK = 0.6, 0.8  # cosine of the normal with the car's sideways axis: lettering ahead and behind has no mirror image
_WHEEL = (5.0, 0.15, 0.05)
_PANE = (2.0, 0.6, 0.9)
"""Distance from wheels and panes at which lettering begins: px of a blur, blurred share for none and for all."""
_TRUSTED, _EVEN_PAINT = 0.05, 0.8  # weight, and similarity to the main paint, of paint that replaces lettering


def covers_parts(model: Model) -> bool:
    """Return whether paint covers a part completely: a chair's, but not a car's body, which has lamps and lettering."""
    return model.part_head is not None and not set(UNPAINTED) <= set(model.part_head.names)


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
    painted: tuple[tuple[PhotoMaps, ...], ColourMatch] | None = CACHE.get(CacheKind.DETAIL, key)
    if painted is None:
        yield None
        with torch.inference_mode():
            painted = _painted_maps(photos, ends, instance)
        CACHE.put(CacheKind.DETAIL, key, painted, sum(photo.size for photo in painted[0]))
    space = edits_to_fitted(instance), instance.codes.proportions
    return DetailMaps(painted[0], strength, detail.other_side, painted[1], *space, len(ends))


def _ends(instance: Instance, photos: list["ComparedPhoto"]) -> Generator[None, None, tuple[BorrowedEnd, ...]]:
    """Return the ends borrowed from a training object, for the mirrored side only; cached."""
    if instance.detail is None or instance.detail.other_side != "mirrored":
        return ()
    key = "ends", *photos
    ends: tuple[BorrowedEnd, ...] | None = CACHE.get(CacheKind.DETAIL, key)
    if ends is None:
        ends = yield from borrowed_ends(instance.fitted, [photo.coverage for photo in photos])
        CACHE.put(CacheKind.DETAIL, key, ends, sum(end.size for end in ends))
    return ends


def compared_photos(instance: Instance) -> Generator[None, None, list["ComparedPhoto"]]:
    """Compare an object's photos with their renders; cached. Yields None many times on the first call."""
    photos = []
    fitted = instance.fitted
    for view in instance.detail.views if instance.detail else ():
        key = fitted.model, fitted, view
        photo: ComparedPhoto | None = CACHE.get(CacheKind.DETAIL, key)
        if photo is None:
            photo = yield from compare_photo(fitted, view)
            CACHE.put(CacheKind.DETAIL, key, photo, photo.size)
        photos.append(photo)
    return photos


@dataclass(frozen=True, eq=False)
class ComparedPhoto:
    """A photo and the render of the codes fitted to it, from the photo's camera. Not modified after creation."""

    camera: Camera  # at the size of the render
    fitted: Instance  # to the photo
    photo: Float[Tensor, "3 height width"]  # the object's colours, extrapolated beyond its outline
    render: Float[Tensor, "3 h w"]  # the surface's colours, extrapolated likewise
    weight: Float[Tensor, "h w"]  # 0..1, reliability of the photo's colours
    near: Float[Tensor, "h w"]  # 0..1, zero far beyond the photo's outline
    body: Float[Tensor, "h w"]  # 0..1, zero on wheels and panes
    rough: Float[Tensor, "h w"]  # contrast of the photo's lightness, 0..1
    alike: Float[Tensor, "h w"]  # 0..1, similarity to the main paint
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
        """Return the photo in the texture and the paints of another object.

        Paints cover a part of a chair as in the render; a car's body has lettering, lamps and a grille.
        """
        paints = textured.codes.edits_of("texture") if covers_parts(textured.model) else ()
        change = self.change(textured.unpainted if paints else textured)
        photo = self.repainted(change) if change.any() else self.photo
        colours = below = photo.movedim(0, -1)
        for paint, place in zip(paints, self.texels.memberships(textured) if paints else (), strict=True):
            below = paint.in_photo(self._matched).over(colours, below, enlarged(place[None], photo)[0])
        return below.movedim(-1, 0)

    def _matched(self, before: Colour, colour: Colour) -> tuple[Colour, Colour]:
        """Return a colour of the render, and one that takes its place, as the photo shows them."""
        offset = self.match.change(before)
        matched = before + offset
        return matched, matched + moved_paint(colour - before, offset)

    def repainted(self, change: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 height width"]:
        """Return the photo repainted, given the change of the render.

        Paint is where that changes like the main paint and the photo is calm, unlike in lamps and a grille, and where
        the photo has the main paint's colour. Around such places it changes evenly: a texture is never quite even.
        """
        offset = self.match.change(self.render.movedim(0, -1)).movedim(-1, 0)
        certain = self.alike * self.weight
        photo, render, even = (
            (certain * image).sum((1, 2), keepdim=True) / certain.sum().clamp_min(1e-6)
            for image in (resized(self.photo, certain), self.render, change)
        )
        reach, least, enough = _AROUND
        strength = change.abs().amax(0) / even.abs().amax().clamp_min(_UNCHANGED)
        main = smooth_step(blurred(certain[None], reach), least, enough) * smooth_step(strength, *_OTHER)
        paint = torch.lerp(self.render + offset, photo, main)
        moved = torch.lerp(moved_paint(change, offset), moved_paint(even, photo - render), main)
        painted = self.body * smooth_step(strength - _ROUGH * self.rough, *_PAINTED)
        painted = torch.maximum(painted, self.alike)
        colour, moved, painted = enlarged(torch.cat((paint, moved, painted[None])), self.photo).split((3, 3, 1))
        return repainted(self.photo, colour, moved, painted[0])

    @property
    def size(self) -> int:
        """bytes"""
        maps = (value for value in vars(self).values() if isinstance(value, Tensor))
        return sum(image.nbytes for image in maps) + self.texels.size


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
        normals = surface_normals(rays.origins, rays.directions, source)
        mask = resized(torch.from_numpy(rgba[None, ..., 3].copy()), source.opacity)[0]
        kept = smooth_step(distance(torch.from_numpy(view.kept(camera.width, high)), beyond=True), 0.0, _SHAPE_FADE)
        photo = _object_colours(rgba)
        render = surface_colours(source)
        surface = torch.cat((normals, source.depth[..., None]), -1).movedim(-1, 0)
        surface = continued(surface, source.opacity > 0.5)
        texels, parts = surface_texels(fitted, rays, source)
    yield None
    with torch.inference_mode():
        small = resized(photo, source.opacity)
        weight = kept * paint_weight(mask, source)
        near = kept * smooth_step(distance(mask < 0.5), _REACH, 0.5)
        match = colour_match(render.flatten(1), small.flatten(1), weight.flatten())
        roof = smooth_step(normals[..., 2], *_UPWARD) * (1 - parts.get("glass", torch.ones_like(mask)))
        weight = weight * _without_glass_above(small, render, roof)
        body, rough, alike = _paint_places(small, parts, weight)
        main = blurred(continued(small, (alike > 0.5) & (weight > _TRUSTED)), _PANE[0])
        letters = lettering(photo, main, _flank(parts, normals, weight))
    return ComparedPhoto(
        camera, fitted, photo, render, weight, near, body, rough, alike, letters, surface, texels, match
    )


def _flank(
    parts: dict[str, Float[Tensor, "h w"]], normals: Float[Tensor, "h w 3"], weight: Float[Tensor, "h w"]
) -> Float[Tensor, "h w"]:
    """Return the places that can have lettering, 0..1: paint of a car's sides, away from wheels and panes.

    Other objects have none: a chair's slats look like letters.
    """
    if not set(UNPAINTED) <= set(parts):
        return torch.zeros_like(weight)
    wheels, glass = (parts[name] for name in UNPAINTED)
    body = 1 - wheels - glass
    wheel_blur, *wheel_ends = _WHEEL
    pane_blur, *pane_ends = _PANE
    beside_wheels = smooth_step(blurred(wheels[None], wheel_blur)[0], *wheel_ends)
    beside_panes = smooth_step(blurred(body[None], pane_blur)[0], *pane_ends)
    return (weight > 0) * body * (beside_wheels * beside_panes) * smooth_step(normals[..., 0].abs(), *_FLANK)


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
    hue = same_hue(photo, paint)
    light = light_share(photo, paint)
    vivid = smooth_step(chroma(paint).abs().amax(0) / (0.3 + 0.7 * lightness(paint)), *_VIVID)
    alike = body * smooth_step(light, *_GREY_LIT) * smooth_step(rough, *_CALM)
    if "glass" in parts:
        beside = smooth_step(blurred(body[None], _BESIDE)[0], 0.02, 0.2)  # no highlight amid a pane
        alike = torch.maximum(alike, beside * parts["glass"] * smooth_step(light, *_FRAME))
    alike = blurred((hue * torch.maximum(alike, vivid * smooth_step(light, *_LIT)))[None], 1.0)[0]
    return body, rough, alike


def _roughness(image: Float[Tensor, "3 h w"]) -> Float[Tensor, "h w"]:
    """Return the standard deviation of lightness in the calmest of the windows around each pixel."""
    light = lightness(image)[None]
    deviation, reach = _WINDOW
    variance = blurred(light**2, deviation) - blurred(light, deviation) ** 2
    return -functional.max_pool2d(-variance.clamp_min(0).sqrt(), reach, 1, reach // 2)[0]


def _painted_maps(
    photos: Sequence[ComparedPhoto], ends: Sequence[BorrowedEnd], textured: Instance
) -> tuple[tuple[PhotoMaps, ...], ColourMatch]:
    """Return the maps of photos and borrowed ends in a texture, and its match to the photos."""
    maps = []
    colours = []
    paints = []
    weights = []
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
        paint = (compared.alike > _EVEN_PAINT) & (compared.weight > _TRUSTED)
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
    across = padded[1:-1, 2:] - 2 * depth + padded[1:-1, :-2]
    down = padded[2:, 1:-1] - 2 * depth + padded[:-2, 1:-1]
    return torch.maximum(across.abs(), down.abs()) > _LEAP


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
