"""Training pixels as rays, and the visual hulls that say where along a ray an object can be."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import pixel_centres
from core.geometry.rays import Rays, cast_rays
from core.lab.datasets.srn import Dataset
from core.lab.training.visual_hull import grid_centres, visual_hull
from core.models.field import Field
from core.runtime.precision import autocast

_HULL_RESOLUTION = 64
"""Cells of a hull along each axis: a cell is about one pixel of the training images."""
_MIN_OPACITY = 0.02
"""A cell that absorbs less of the light than this is empty."""
_MASK_MARGIN = 3
"""px around the mask from which rays are sampled too: as far as the hull may reach beyond the object."""
_DILATE_BATCH = 512
"""masks"""
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
    """0 off the object, 1 across its border, 2 on it"""


class RayDataset:
    """All training pixels on and around the objects, or all pixels (``whole_image``), on one device."""

    def __init__(
        self, dataset: Dataset, extent: tuple[float, float, float], device: torch.device, whole_image: bool
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
        self.images = torch.from_numpy(np.concatenate([views.images for views in objects])).to(device).flatten(1, 2)
        masks = torch.from_numpy(np.concatenate([views.masks for views in objects]))
        mask_class = _dilate(masks, 1).to(torch.uint8) + (~_dilate(~masks, 1)).to(torch.uint8)
        self.mask_class = mask_class.flatten(1).to(device)
        self.whole_image = whole_image
        if whole_image:
            self.hulls = torch.ones(len(objects), *[_HULL_RESOLUTION] * 3, dtype=torch.bool, device=device)
            return
        view, pixel = _dilate(masks, _MASK_MARGIN).flatten(1).nonzero(as_tuple=True)
        self.view, self.pixel = view.to(torch.int32).to(device), pixel.to(torch.int32).to(device)
        self.hulls = torch.stack([visual_hull(views, extent, _HULL_RESOLUTION) for views in objects]).to(device)

    def sample(self, count: int, generator: torch.Generator) -> RayBatch:
        """Rays through random pixels."""
        view, pixel = self._sample_pixels(count, generator)
        azimuth, elevation, distance = self.angles[view].unbind(-1)
        rays = cast_rays(self.centres[pixel], azimuth, elevation, distance, self.focal, self.size, self.extent)
        return RayBatch(rays, self.owner[view], self.images[view, pixel].float() / 255, self.mask_class[view, pixel])

    def _sample_pixels(self, count: int, generator: torch.Generator) -> tuple[Int[Tensor, "rays"], Int[Tensor, "rays"]]:
        """Indices of views, and of one pixel of each."""
        device = self.images.device
        if self.whole_image:
            views, pixels = self.images.shape[:2]
            view, pixel = (torch.randint(n, (count,), generator=generator, device=device) for n in (views, pixels))
            return view, pixel
        index = torch.randint(len(self.view), (count,), generator=generator, device=device)
        return self.view[index].long(), self.pixel[index].long()

    def inside_hull(self, points: Float[Tensor, "*batch 3"], owner: Int[Tensor, "*#batch"]) -> Bool[Tensor, "*batch"]:
        """Whether each point lies in its object's hull."""
        cells = ((points / self.extent + 1) * (_HULL_RESOLUTION / 2)).long().clamp(0, _HULL_RESOLUTION - 1)
        x, y, z = cells.unbind(-1)
        return self.hulls.flatten()[((owner * _HULL_RESOLUTION + x) * _HULL_RESOLUTION + y) * _HULL_RESOLUTION + z]

    @torch.no_grad()
    def prune(self, field: Field, shape_bias: Float[Tensor, "objects blocks width"]) -> None:
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


def _dilate(masks: Bool[Tensor, "views height width"], reach: int) -> Bool[Tensor, "views height width"]:
    """Masks dilated by ``reach`` px."""
    # In parts: as floats at once, the masks of a large dataset take gigabytes.
    size, parts = 2 * reach + 1, masks.split(_DILATE_BATCH)
    return torch.cat([functional.max_pool2d(part[:, None].float(), size, 1, reach)[:, 0] > 0 for part in parts])
