"""Visual hulls: the space that no mask rules out, to which training confines the object."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.lab.datasets.srn import ObjectViews

Extent = tuple[float, float, float]

_CELLS = 32  # along each axis of the grid from which the box around all objects follows
_MASK_SIDE = 128  # px: larger masks are reduced to this, a pixel being set if any of its parts is


def grid_centres(extent: Extent, resolution: int) -> Float[Tensor, "cells 3"]:
    """Return the world centres of grid cells over the box [-extent, extent], x slowest."""
    axes = [(torch.arange(resolution) + 0.5) / resolution * 2 * half - half for half in extent]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def visual_hull(
    views: ObjectViews, extent: Extent, resolution: int, device: torch.device | None = None
) -> Bool[Tensor, "resolution resolution resolution"]:
    """Find cells that may contain the object: their centres project into the dilated mask in every view.

    Masks are dilated by half a cell's diagonal in the image, so no cell of the object is lost. Points outside an image
    are not ruled out by it.
    """
    centres = grid_centres(extent, resolution).to(device)
    remaining = torch.arange(len(centres), device=device)
    cell = 2 * float(torch.tensor(extent).norm()) / resolution
    for full_mask, original in zip(views.masks, views.cameras, strict=True):
        side = min(_MASK_SIDE, original.width)
        camera = original.resized(side, side)
        mask = functional.adaptive_max_pool2d(torch.from_numpy(full_mask)[None].to(device).float(), side)
        nearest = max(camera.distance - 0.5, 0.5 * camera.distance)
        reach = math.ceil(cell / 2 * camera.focal / nearest)
        dilated = functional.max_pool2d(mask, 2 * reach + 1, 1, reach)[0] > 0
        columns, rows = camera.project(centres[remaining]).floor().long().unbind(-1)
        in_image = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        inside = dilated[rows.clamp(0, camera.height - 1), columns.clamp(0, camera.width - 1)]
        remaining = remaining[inside | ~in_image]
    hull = torch.zeros(len(centres), dtype=torch.bool, device=device)
    hull[remaining] = True
    return hull.reshape(resolution, resolution, resolution)


def shared_extent(objects: Sequence[ObjectViews], device: torch.device | None = None) -> Extent:
    """Return the smallest origin-centred box around the hulls of all objects, with one cell of margin."""
    occupied = torch.zeros((_CELLS,) * 3, dtype=torch.bool, device=device)
    for views in objects:
        occupied |= visual_hull(views, (0.5, 0.5, 0.5), _CELLS, device)
    centres = grid_centres((0.5, 0.5, 0.5), _CELLS)[occupied.reshape(-1).cpu()]
    if not len(centres):
        raise ValueError("the masks rule out all space: poses and masks do not match")
    reach = (centres.abs().amax(0) + 1.5 / _CELLS).clamp_max(0.5)
    return (float(reach[0]), float(reach[1]), float(reach[2]))
