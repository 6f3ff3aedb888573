"""Training pixels as rays, and the visual hulls that say where along a ray an object can be."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import pixel_centres
from core.geometry.rays import Rays, cast_rays
from core.lab.datasets.srn import Dataset, ObjectViews
from core.lab.training.visual_hull import dilate, grid_centres, visual_hull
from core.models.field import Field
from core.runtime.precision import autocast

_HULL_RESOLUTION = 64
"""Cells of a hull along each axis."""
_MIN_OPACITY = 0.02
"""A cell that absorbs less of the light than this is empty."""
_MASK_MARGIN = 0.023
"""image widths around the mask from which rays are sampled too: as far as the hull may reach beyond the object"""
_EDGE_FRACTION = 0.25
"""of the rays, beside those that fall there by chance, pass within one pixel of the mask's border: thin parts have few
pixels and all of them there"""
_PRUNE_BATCH = 16384
"""cells"""


class RayBatch(NamedTuple):
    """Rays through training pixels."""

    rays: Rays
    owner: Int[Tensor, "rays"]
    """index of each ray's object"""
    colours: Float[Tensor, "rays 3"]
    """0..1"""
    mask_class: UInt8[Tensor, "rays"]
    """0 off the object, 1 across its border, 2 on it; a point-sampled image has no pixel across it"""


class _Group(NamedTuple):
    """The pixels of some objects, from which a share of every batch is sampled."""

    share: float
    pixels: tuple[int, int]
    """first and one past the last, in :class:`RayDataset`'s columns"""
    edges: tuple[int, int]
    """the same in its edges"""


class RayDataset:
    """All training pixels on and around the objects, or all pixels (``whole_image``), on one device.

    Args:
        shares: of the rays of a batch, for each folder of the dataset; none: as many as its pixels.

    Raises ``ValueError`` for shares that are not positive or not one for each folder.
    """

    def __init__(
        self,
        dataset: Dataset,
        extent: tuple[float, float, float],
        device: torch.device,
        whole_image: bool,
        shares: tuple[float, ...] = (),
    ) -> None:
        objects = dataset.objects
        cameras = [camera for views in objects for camera in views.cameras]
        self.size = (dataset.image_size, dataset.image_size)
        self.focal = dataset.focal
        self.centres = pixel_centres(*self.size, device).flatten(0, 1)
        self.extent = torch.tensor(extent, device=device)
        angles = [(camera.azimuth, camera.elevation, camera.distance) for camera in cameras]
        self.angles = torch.tensor(angles, device=device)
        owners = [index for index, views in enumerate(objects) for _ in views.cameras]
        self.owner = torch.tensor(owners, device=device)
        margin = None if whole_image else max(1, round(_MASK_MARGIN * dataset.image_size))
        counts = [len(views.cameras) for views in objects]
        first = np.cumsum([0, *counts[:-1]])
        parts = [_pixels(one, int(at), margin, dataset.point_sampled) for one, at in zip(objects, first, strict=True)]
        joined = (torch.cat(column).to(device) for column in zip(*parts, strict=True))
        self.view, self.pixel, self.colours, self.mask_class, on_edge = joined
        self.edges = on_edge.nonzero()[:, 0].to(torch.int32)
        if whole_image:
            self.hulls = torch.ones(len(objects), *[_HULL_RESOLUTION] * 3, dtype=torch.bool, device=device)
        else:
            self.hulls = torch.stack([visual_hull(views, extent, _HULL_RESOLUTION) for views in objects]).to(device)
        self._edge_fraction = 0.0 if whole_image else _EDGE_FRACTION
        self._groups = self._group(shares, dataset.counts if shares else (len(objects),))

    def _group(self, shares: tuple[float, ...], counts: tuple[int, ...]) -> list[_Group]:
        """One group for each folder, with its share of a batch; one of all pixels where there are no shares."""
        shares = shares or (1.0,)
        if len(shares) != len(counts) or min(shares) <= 0:
            raise ValueError(f"{len(counts)} datasets need as many positive shares, got {shares}")
        ends = torch.tensor([0, *counts]).cumsum(0).to(self.owner)
        pixels = torch.searchsorted(self.view, torch.searchsorted(self.owner, ends).to(self.view))
        edges = torch.searchsorted(self.edges, pixels.to(self.edges))
        spans = (list(pairwise(column.tolist())) for column in (pixels, edges))
        return [_Group(share / sum(shares), *span) for share, *span in zip(shares, *spans, strict=True)]

    def sample(self, count: int, generator: torch.Generator) -> RayBatch:
        """Rays through random pixels."""
        ends = np.cumsum([group.share for group in self._groups]) * count
        counts = np.diff(np.rint(ends), prepend=0).astype(int)
        parts = [self._choose(group, n, generator) for group, n in zip(self._groups, counts.tolist(), strict=True)]
        index = torch.cat(parts)
        view, pixel = self.view[index].long(), self.pixel[index].long()
        azimuth, elevation, distance = self.angles[view].unbind(-1)
        rays = cast_rays(self.centres[pixel], azimuth, elevation, distance, self.focal, self.size, self.extent)
        return RayBatch(rays, self.owner[view], self.colours[index].float() / 255, self.mask_class[index])

    def _choose(self, group: _Group, count: int, generator: torch.Generator) -> Int[Tensor, "count"]:
        """Random pixels of a group; of those at borders of masks, more than come by chance."""
        device = self.view.device
        index = torch.randint(*group.pixels, (count,), generator=generator, device=device)
        on_edge = round(self._edge_fraction * count) if group.edges[0] < group.edges[1] else 0
        if on_edge:
            chosen = torch.randint(*group.edges, (on_edge,), generator=generator, device=device)
            index[:on_edge] = self.edges[chosen].long()
        return index

    def inside_hull(self, points: Float[Tensor, "*batch 3"], owner: Int[Tensor, "*#batch"]) -> Bool[Tensor, "*batch"]:
        """Whether each point lies in its object's hull."""
        cells = ((points / self.extent + 1) * (_HULL_RESOLUTION / 2)).long().clamp(0, _HULL_RESOLUTION - 1)
        x, y, z = cells.unbind(-1)
        return self.hulls.flatten()[((owner * _HULL_RESOLUTION + x) * _HULL_RESOLUTION + y) * _HULL_RESOLUTION + z]

    @torch.no_grad()
    def prune(self, field: Field, shape_bias: Float[Tensor, "objects blocks modulation"]) -> None:
        """Remove from the hulls the cells that the field has found empty and whose neighbours are empty too."""
        centres = grid_centres(tuple(self.extent.tolist()), _HULL_RESOLUTION).to(self.extent.device)
        step = 2 * self.extent.amin() / _HULL_RESOLUTION
        for hull, bias in zip(self.hulls, shape_bias, strict=True):
            cells = hull.flatten().nonzero()[:, 0]
            with autocast(hull.device):
                density = [field.density(centres[part], bias)[0] for part in cells.split(_PRUNE_BATCH)]
            opacity = torch.zeros(hull.numel(), device=hull.device)
            opacity[cells] = -torch.expm1(-torch.cat(density) * step)
            near = functional.max_pool3d(opacity.reshape(1, *hull.shape), 3, 1, 1)[0]
            hull &= near > _MIN_OPACITY


def _pixels(views: ObjectViews, first: int, margin: int | None, point_sampled: bool) -> tuple[Tensor, ...]:
    """An object's pixels within ``margin`` px of its masks, or all of them.

    Returns columns of equal length: view (counted from ``first``), index in the image, colour, mask class, and whether
    the pixel lies at the mask's border.
    """
    images, masks = torch.from_numpy(views.images).flatten(1, 2), torch.from_numpy(views.masks)
    near, inside = dilate(masks, 1), ~dilate(~masks, 1)
    mask_class = 2 * masks.to(torch.uint8) if point_sampled else near.to(torch.uint8) + inside.to(torch.uint8)
    chosen = torch.ones_like(masks) if margin is None else dilate(masks, margin)
    view, pixel = chosen.flatten(1).nonzero(as_tuple=True)
    columns = (one.flatten(1)[view, pixel] for one in (mask_class, near & ~inside))
    return (view + first).to(torch.int32), pixel.to(torch.int32), images[view, pixel], *columns
