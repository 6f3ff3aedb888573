"""Photo detail: colours of surface points looked up in photos of the object.

A photo provides maps over its camera's image: its colours with weights, those of the mirrored side, and the
surface (:class:`PhotoMaps`). A point takes the colour of the pixel into which it projects if the photo shows
the same surface (a soft depth test) from the same side; near the photo's own camera it takes the colour fully. Points
that no camera saw take the colour of their mirror image (-x, y, z) if a camera saw that. Other points take the model's
colour matched to the photos, so that no edge shows where a photo ends. Opacity and depth do not change.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.edits import kinds
from core.edits.edit import Edit
from core.geometry.camera import Camera, Factors
from core.models.photo_detail import OtherSide
from core.rendering.reference import Rendered
from core.runtime.caches import Cached

DEPTH_NEAR, DEPTH_FAR = 0.012, 0.035
"""Depth test: scene units along the photo's ray between a point and the surface in the photo.

A point nearer than the first lies on that surface, a point beyond the second does not."""
FACING = 0.25  # cosine of viewing ray and surface normal above which the viewer sees the side that the photo shows
FLAT = math.cos(math.radians(83))
STEEP = math.cos(math.radians(70))
"""Cosines of photo ray and surface normal: the photo gives no colour below the first, its full colour above the second.
"""
BESIDE = math.cos(math.radians(25)), math.cos(math.radians(8))
"""Cosines of photo ray and viewing ray: beside the photo's camera, its colours are right at any surface angle."""
NEAR = math.cos(math.radians(6)), math.cos(math.radians(2))
"""The same cosines for a viewer at the photo's own camera: the object looks as in the photo, up to its outline."""
NEAR_FIRST = 20.0  # weight of a photo whose own camera is the viewer; other photos weigh at most 1
NEAR_DEPTHS = 0.2, 0.1  # depth test for NEAR, scene units: at an outline, depth lies between object and background
MIN_OPACITY = 0.02  # pixels of less opacity take no photo detail


class ColourMatch(NamedTuple):
    """An affine map of each colour channel, from the model's colours to those of the photos."""

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def change(self, colours: Float[Tensor, "*places 3"]) -> Float[Tensor, "*places 3"]:
        """Return the change of colours (0..1) by the match: matched colours minus colours."""
        gain = torch.tensor(self.gain, device=colours.device)
        offset = torch.tensor(self.offset, device=colours.device)
        return colours * (gain - 1) + offset


class Sources(NamedTuple):
    """Fractions of colours by their source, 0..1; the rest is the model's."""

    photo: Float[Tensor, "*places"]
    mirrored: Float[Tensor, "*places"]  # from a photo of the mirror image


@dataclass(frozen=True, eq=False)
class PhotoMaps(Cached):
    """Maps over the image of one photo's camera. Not modified after creation."""

    camera: Camera  # at any size: maps cover its whole image
    fine: tuple[Float[Tensor, "4 _ _"], ...]
    """The photo's colours (sRGB) and :func:`packed` weights; each level halves the resolution of the previous one."""
    mirrored: tuple[Float[Tensor, "4 _ _"], ...]
    """:attr:`fine` for the mirror image: the same, or one with paint in place of lettering"""
    surface: Float[Tensor, "4 rows columns"]  # unit normal (world) and distance from the camera (scene units)

    def level(self, camera: Camera) -> int:
        """Return the level of the fine map whose pixels are as large on the object as a camera's."""
        pixels_per_unit = self.camera.focal * self.fine[0].shape[1] / self.camera.height / self.camera.distance
        ratio = pixels_per_unit * camera.distance / camera.focal
        return max(0, min(len(self.fine) - 1, round(math.log2(max(ratio, 1e-6)))))

    def look_up(
        self,
        points: Float[Tensor, "points 3"],
        origins: Float[Tensor, "points 3"],
        directions: Float[Tensor, "points 3"],
        map: Float[Tensor, "4 _ _"],
        proportions: Factors | None = None,
    ) -> tuple[Float[Tensor, "points 4"], Float[Tensor, "points"], Float[Tensor, "points"]]:
        """Sample a map where points' origins project; return its values and two weights, 0..1.

        The first weight tells if the photo shows the point from the viewer's side, the second if the viewer is at the
        photo's own camera.

        Args:
            origins: the points on the fitted object, which differ on an edited one.
            directions: unit viewing directions.
            proportions: of the space of the viewer; the photo's camera stays where the photo was taken.
        """
        rotation, origin = self.camera.world_to_camera(points.device)
        away = origins - origin
        local = away @ rotation.T
        scale = 2 * self.camera.focal / (-local[:, 2]).clamp_min(1e-6)
        uv = torch.stack((local[:, 0] * scale / self.camera.width, -local[:, 1] * scale / self.camera.height), -1)
        surface = _sampled(self.surface, uv)
        distance = away.norm(dim=-1)
        ray = away / distance[:, None].clamp_min(1e-6)
        behind = (distance - surface[:, 3]).abs()
        facing = smooth_step(-(directions * surface[:, :3]).sum(-1), 0.0, FACING)
        steep = smooth_step(-(ray * surface[:, :3]).sum(-1), FLAT, STEEP)
        if proportions is not None:
            factors = points.new_tensor(proportions)
            points = points * factors
            directions = functional.normalize(directions * factors, dim=-1)
        cosine = (functional.normalize(points - origin, dim=-1) * directions).sum(-1)
        same_side = torch.maximum(facing * steep, smooth_step(cosine, *BESIDE))
        visible = smooth_step(behind, DEPTH_FAR, DEPTH_NEAR) * same_side
        near = smooth_step(cosine, *NEAR) * smooth_step(behind, *NEAR_DEPTHS)
        inside = (local[:, 2] < 0) & (uv.abs() <= 1).all(-1)
        return _sampled(map, uv), inside * visible, inside * near


@dataclass(frozen=True, eq=False)
class DetailMaps:
    """The maps of all photos of an object, with the settings for showing them."""

    photos: tuple[PhotoMaps, ...]
    strength: float = 1.0  # factor on all detail
    other_side: OtherSide = "mirrored"
    match: ColourMatch = field(default_factory=ColourMatch)  # applied to the model's colours outside all photos
    edits: tuple[Edit, ...] = ()  # of the space of the object that was fitted to the photos
    proportions: Factors | None = None  # :attr:`core.models.codes.Codes.proportions`
    borrowed: int = 0  # the last maps, of a training object (:mod:`core.detail.borrowed`): their share is the model's

    def added(self, rendered: Rendered, camera: Camera) -> tuple[Rendered, Sources]:
        """Return a render with photo detail added, and the sources of its colours. Opacity and depth do not change.

        Args:
            camera: of the object's own space (:meth:`core.models.model.Instance.local_camera`).
        """
        index = (rendered.opacity.flatten() > MIN_OPACITY).nonzero()[:, 0]
        _, origin = camera.world_to_camera(index.device)
        pixels = torch.stack((index % camera.width, index // camera.width), -1) + 0.5
        directions = camera.directions(pixels)
        points = origin + directions * rendered.depth.flatten().index_select(0, index)[:, None]
        opacity = rendered.opacity.flatten().index_select(0, index)
        left = (1 - opacity)[:, None]
        model_colours = (rendered.colour.flatten(0, 1).index_select(0, index) - left) / opacity[:, None]
        change, sources = self.colour_changes(points, directions, model_colours.clamp(0, 1), camera)
        colour = rendered.colour.flatten(0, 1).index_add(0, index, opacity[:, None] * change).clamp(max=1)
        colour = torch.maximum(colour, 1 - rendered.opacity.flatten()[:, None])  # keep the background's light
        empty = torch.zeros_like(rendered.opacity)
        images = (empty.flatten().index_add(0, index, opacity * source).view_as(empty) for source in sources)
        return replace(rendered, colour=colour.view_as(rendered.colour)), Sources(*images)

    def colour_changes(
        self,
        points: Float[Tensor, "points 3"],
        directions: Float[Tensor, "points 3"],
        colours: Float[Tensor, "points 3"],
        camera: Camera | None = None,
    ) -> tuple[Float[Tensor, "points 3"], Sources]:
        """Return the change of colours at surface points, and the sources of the new colours.

        Args:
            directions: unit viewing directions; for a mesh the inverted outward normals.
            colours: the model's, 0..1.
            camera: sets the resolution of the photos: that of its pixels; None: full resolution.
        """
        levels = [photo.level(camera) if camera else 0 for photo in self.photos]
        count = len(self.photos) - self.borrowed
        fine = [photo.fine[level] for photo, level in zip(self.photos[:count], levels, strict=False)]
        origins = kinds.origins(points, self.edits)
        colour, weights = self._blended(points, origins, directions, fine, own=True)
        direct = weights.amax(0)
        change = direct[:, None] * (colour - colours)
        covered = direct.clone()
        mirrored = torch.zeros_like(direct)
        if self.other_side != "model":
            hidden = (direct < 0.99).nonzero()[:, 0]
            turn = torch.tensor([-1.0, 1.0, 1.0], device=points.device)
            rows = points, origins, directions
            twins, twin_origins, twin_directions = (row.index_select(0, hidden) * turn for row in rows)
            fine = [photo.mirrored[level] for photo, level in zip(self.photos, levels, strict=True)]
            colour, weights = self._blended(twins, twin_origins, twin_directions, fine)
            colour = colour - colours.index_select(0, hidden)
            weights = weights * (1 - direct.index_select(0, hidden))
            weight = weights.amax(0)
            change.index_add_(0, hidden, weight[:, None] * colour)
            covered.index_add_(0, hidden, weight)
            mirrored.index_add_(0, hidden, weights[:count].amax(0))
        change += (1 - covered)[:, None] * self.match.change(colours)
        return self.strength * change, Sources(self.strength * direct, self.strength * mirrored)

    def _blended(
        self,
        points: Float[Tensor, "points 3"],
        origins: Float[Tensor, "points 3"],
        directions: Float[Tensor, "points 3"],
        maps: Sequence[Float[Tensor, "4 _ _"]],
        own: bool = False,
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "photos points"]]:
        """Average the photos' colours of points by weight; return the mean and each photo's weight (0..1).

        Args:
            maps: one of each photo, or of the first ones.
            own: a photo also colours every surface that a viewer at its own camera sees.
        """
        colours = list[Float[Tensor, "points 3"]]()
        weights = list[Float[Tensor, "points"]]()  # 0..1
        factors = list[Float[Tensor, "points"]]()  # of the average
        for photo, map in zip(self.photos, maps, strict=False):
            values, visible, near = photo.look_up(points, origins, directions, map, self.proportions)
            weight, reach = unpacked(values[:, 3])
            near = reach * near
            weight = torch.maximum(visible * weight, near) if own else visible * weight
            colours.append(values[:, :3])
            weights.append(weight)
            factors.append(weight.square() + NEAR_FIRST * near if own else weight.square())
        if len(colours) == 1:
            return colours[0], weights[0][None]
        factor = torch.stack(factors)[..., None]
        return (factor * torch.stack(colours)).sum(0) / factor.sum(0).clamp_min(1e-6), torch.stack(weights)


def packed(weight: Float[Tensor, "*any"], reach: Float[Tensor, "*any"]) -> Float[Tensor, "*any"]:
    """Pack two weights into one channel: ``reach`` is 1 wherever ``weight`` is not 0.

    Args:
        weight: 0..1, for views from anywhere.
        reach: 0..1, for views from the photo's own camera.
    """
    return (weight + reach) / 2


def unpacked(value: Float[Tensor, "*any"]) -> tuple[Float[Tensor, "*any"], Float[Tensor, "*any"]]:
    """Return weight and reach of :func:`packed`."""
    return (2 * value - 1).clamp(0, 1), (2 * value).clamp(0, 1)


def _sampled(map: Float[Tensor, "channels h w"], uv: Float[Tensor, "points 2"]) -> Float[Tensor, "points channels"]:
    """Sample bilinearly; 0 outside the image."""
    return functional.grid_sample(map[None], uv[None, None], align_corners=False)[0, :, 0].T


def smooth_step(value: Float[Tensor, "*any"], start: float, end: float) -> Float[Tensor, "*any"]:
    """Return a smooth transition from 0 at value ``start`` to 1 at value ``end``, which may be smaller."""
    progress = ((value - start) / (end - start)).clamp(0, 1)
    return progress * progress * (3 - 2 * progress)
