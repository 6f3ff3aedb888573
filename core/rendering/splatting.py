"""The distances of cells behind the tiles of an image, to skip empty space along rays."""

import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.camera import Camera, project


def splat(
    camera: Camera,
    centres: Float[Tensor, "cells 3"],
    radius: float,
    size: tuple[int, int],
    offset: tuple[float, float],
) -> tuple[Float[Tensor, "rows columns"], Float[Tensor, "rows columns"]]:
    """Return the nearest and the farthest distance of the cells behind each tile of an image; near > far: none.

    A tile is at least as large as half of the nearest projected cell, and each cell covers the 3x3 tiles around its
    centre, so no cell is missed.

    Args:
        centres: of cells, scene units.
        radius: half of a cell's diagonal, scene units.
        size: px, width and height of the image, which may be a section of the camera's.
        offset: px, from the camera's image to this one.
    """
    local = camera.to_camera_axes(centres)
    lengths = camera.lengths_to(centres)
    points = project(local, camera.focal, (camera.width, camera.height)) + local.new_tensor(offset)
    reach = max(1.0, camera.magnification) * radius
    depth = -local[:, 2]
    closest = float((depth.amin() if len(depth) else torch.tensor(1.0)).clamp_min(1e-3))
    side = max(1.0, reach * camera.focal / closest)
    columns, rows = (max(1, -int(-pixels // side)) for pixels in size)
    # A margin of one tile holds centres of cells that reach in from outside; one more, all others.
    x = (points[:, 0] * (columns / size[0])).floor().long() + 1
    y = (points[:, 1] * (rows / size[1])).floor().long() + 1
    on = (depth > 1e-3) & (x >= 0) & (x < columns + 2) & (y >= 0) & (y < rows + 2)
    count = (rows + 2) * (columns + 2)
    tile = torch.where(on, y * (columns + 2) + x, count)
    reached = torch.full((2, count + 1), -torch.inf, device=local.device)
    reached[0].scatter_reduce_(0, tile, reach - lengths, "amax")
    reached[1].scatter_reduce_(0, tile, reach + lengths, "amax")
    tiles = reached[:, :-1].unflatten(1, (rows + 2, columns + 2))
    tiles = torch.maximum(torch.maximum(tiles[:, :-2], tiles[:, 1:-1]), tiles[:, 2:])
    tiles = torch.maximum(torch.maximum(tiles[..., :-2], tiles[..., 1:-1]), tiles[..., 2:])
    return -tiles[0], tiles[1]
