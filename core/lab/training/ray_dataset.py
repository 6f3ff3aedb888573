"""Training pixels as rays, and visual hulls that bound the object along each ray."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import pixel_centres
from core.geometry.rays import Rays, cast_rays
from core.lab.datasets.srn import Dataset, ObjectViews
from core.lab.training.processes import Processes
from core.lab.training.visual_hull import Extent, grid_centres, visual_hull
from core.models.field import Field
from core.runtime.precision import autocast
from core.runtime.threads import thread_count

_HULL_RESOLUTION = 64  # cells of a hull along each axis
_MIN_OPACITY = 0.02  # a cell with less opacity is empty
_MASK_MARGIN = 3 / 128  # image widths around the mask that also supply rays: as far as a hull extends beyond it
_PIXELS_PER_VIEW = 8192  # at most, chosen at random: more images help more than all pixels of each
_PRUNE_BATCH = 65536  # cells


class RayBatch(NamedTuple):
    """Rays through training pixels."""

    place: Int[Tensor, "rays"]  # index of each ray in the batch of all processes
    rays: Rays
    owner: Int[Tensor, "rays"]  # index of each ray's object
    colours: Float[Tensor, "rays 3"]  # 0..1
    mask_class: UInt8[Tensor, "rays"]  # 0 off the object, 1 across its border, 2 on it


class _Pixels(NamedTuple):
    """Training pixels of an object, as arrays of equal length."""

    view: Int[np.ndarray, "pixels"]
    pixel: Int[np.ndarray, "pixels"]  # index in the image, row by row
    colour: UInt8[np.ndarray, "pixels 3"]
    mask_class: UInt8[np.ndarray, "pixels"]


class RayDataset:
    """Training pixels on and around the objects, or all pixels (``whole_image``), on one device.

    Pixels are those of this process's own objects, hulls those of all.
    """

    def __init__(
        self, dataset: Dataset, extent: Extent, device: torch.device, whole_image: bool, processes: Processes
    ) -> None:
        if processes.count > len(dataset.objects):
            raise ValueError(f"{processes.count} processes need as many objects, got {len(dataset.objects)}")
        self.processes = processes
        objects = dataset.objects[processes.own]
        self.size = (dataset.image_size, dataset.image_size)
        self.focal = dataset.focal
        self.centres = pixel_centres(*self.size, device).flatten(0, 1)
        self.extent = torch.tensor(extent, device=device)
        cameras = [camera for views in objects for camera in views.cameras]
        angles = [(camera.azimuth, camera.elevation, camera.distance) for camera in cameras]
        self.angles = torch.tensor(angles, device=device)
        numbers = range(len(dataset.objects))[processes.own]
        with ThreadPoolExecutor(thread_count()) as pool:  # torch's operations release the interpreter lock
            pixels = list(pool.map(partial(_training_pixels, whole_image), objects, numbers))
        view_counts = [len(views.cameras) for views in objects]
        first_view = (np.cumsum(view_counts) - view_counts).astype(np.int32)
        numbered = (
            sampled._replace(view=sampled.view + first) for sampled, first in zip(pixels, first_view, strict=True)
        )
        columns = (torch.from_numpy(np.concatenate(column)).to(device) for column in zip(*numbered, strict=True))
        self.view, self.pixel, self.colour, self.mask_class = columns
        self.count = torch.tensor([len(sampled.view) for sampled in pixels], device=device)
        self.first = self.count.cumsum(0) - self.count
        self.weight = torch.tensor(dataset.weights or [1.0] * len(dataset.objects), device=device)
        self.hulls = torch.ones(len(dataset.objects), *[_HULL_RESOLUTION] * 3, dtype=torch.bool, device=device)
        if not whole_image:
            for hull, own_views in zip(self.hulls[processes.own], objects, strict=True):
                hull.copy_(visual_hull(own_views, extent, _HULL_RESOLUTION, device))
            processes.intersect(self.hulls)

    def sample(self, count: int, generator: torch.Generator) -> RayBatch:
        """Sample rays through random pixels; objects are chosen by the dataset's weights.

        All processes sample the same ``count`` rays; each returns the rays of its own objects.
        """
        owner = torch.multinomial(self.weight, count, replacement=True, generator=generator)
        fraction = torch.rand(count, generator=generator, device=owner.device, dtype=torch.float64)
        (rays_here,) = (owner % self.processes.count == self.processes.rank).nonzero(as_tuple=True)
        owner = owner[rays_here]
        object_here = owner // self.processes.count
        index = self.first[object_here] + (fraction[rays_here] * self.count[object_here]).long()
        azimuth, elevation, distance = self.angles[self.view[index].long()].unbind(-1)
        pixels = self.centres[self.pixel[index].long()]
        rays = cast_rays(pixels, azimuth, elevation, distance, self.focal, self.size, self.extent)
        return RayBatch(rays_here, rays, owner, self.colour[index].float() / 255, self.mask_class[index])

    def inside_hull(self, points: Float[Tensor, "*batch 3"], owner: Int[Tensor, "*#batch"]) -> Bool[Tensor, "*batch"]:
        """Tell which points lie in their object's hull."""
        cells = ((points / self.extent + 1) * (_HULL_RESOLUTION / 2)).long().clamp(0, _HULL_RESOLUTION - 1)
        x, y, z = cells.unbind(-1)
        return self.hulls.flatten()[((owner * _HULL_RESOLUTION + x) * _HULL_RESOLUTION + y) * _HULL_RESOLUTION + z]

    @torch.no_grad()
    def prune(self, field: Field, shape_bias: Float[Tensor, "objects blocks width"]) -> None:
        """Remove from the hulls cells that the field finds empty, together with their neighbours."""
        centres = grid_centres(tuple(self.extent.tolist()), _HULL_RESOLUTION).to(self.extent.device)
        step = 2 * self.extent.amin() / _HULL_RESOLUTION
        objects_here = self.processes.own
        for hull, bias in zip(self.hulls[objects_here], shape_bias[objects_here], strict=True):
            cells = hull.flatten().nonzero()[:, 0]
            with autocast(hull.device):
                density = [field.density(centres[batch], bias)[0] for batch in cells.split(_PRUNE_BATCH)]
            opacity = torch.zeros(hull.numel(), device=hull.device)
            opacity[cells] = -torch.expm1(-torch.cat(density).float() * step)
            near = functional.max_pool3d(opacity.reshape(1, *hull.shape), 3, 1, 1)[0]
            hull &= near > _MIN_OPACITY
        self.processes.intersect(self.hulls)


def _training_pixels(whole_image: bool, views: ObjectViews, seed: int) -> _Pixels:
    """Return the training pixels of an object, at most :data:`_PIXELS_PER_VIEW` per view on average."""
    masks = torch.from_numpy(views.masks)
    mask_class = (_dilate(masks, 1).to(torch.uint8) + (~_dilate(~masks, 1)).to(torch.uint8)).flatten(1)
    near = torch.ones_like(masks) if whole_image else _dilate(masks, round(_MASK_MARGIN * masks.shape[-1]))
    view, pixel = (index.numpy() for index in near.flatten(1).nonzero(as_tuple=True))
    limit = _PIXELS_PER_VIEW * len(masks)
    if len(view) > limit and not whole_image:
        chosen_pixels = np.random.default_rng(seed).choice(len(view), limit, replace=False)
        view = view[chosen_pixels]
        pixel = pixel[chosen_pixels]
    colours = views.images.reshape(len(masks), -1, 3)
    labels = mask_class.numpy()[view, pixel]
    return _Pixels(view.astype(np.int32), pixel.astype(np.int32), colours[view, pixel], labels)


def _dilate(masks: Bool[Tensor, "views height width"], reach: int) -> Bool[Tensor, "views height width"]:
    """Dilate masks by ``reach`` px, along rows and then along columns."""
    rows = functional.max_pool2d(masks[:, None].float(), (1, 2 * reach + 1), 1, (0, reach))
    return functional.max_pool2d(rows, (2 * reach + 1, 1), 1, (reach, 0))[:, 0] > 0
