"""Grids of cells over the scene's box: corners, neighbours, and the cell that contains a point.

Flat indices are row-major: x varies slowest, z fastest.
"""

import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor
from torch.nn import functional


def corner_points(extent: Float[Tensor, "3"], count: int) -> Float[Tensor, "corners 3"]:
    """Return the (count + 1)^3 corners of a grid of ``count`` cells along each axis, row-major, in scene units.

    Args:
        extent: half the size of the box, scene units.
    """
    axes = [torch.linspace(-1, 1, count + 1, device=extent.device)] * 3
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) * extent


def unravelled(index: Int[Tensor, "*corners"], count: int) -> Int[Tensor, "*corners 3"]:
    """Return the grid positions of row-major corner indices; ``count`` corners along each axis.

    Replaces :func:`torch.unravel_index`: its first call imports sympy, which takes a third of a second.
    """
    row = index // count
    return torch.stack((row // count, row % count, index % count), -1)


def max_of_corners(corners: Shaped[Tensor, "*batch _ _ _"]) -> Shaped[Tensor, "*batch _ _ _"]:
    """Return the maximum over the eight corners of each cell; for booleans, whether any corner is True."""
    for axis in (-3, -2, -1):
        length = corners.shape[axis] - 1
        corners = torch.maximum(corners.narrow(axis, 0, length), corners.narrow(axis, 1, length))
    return corners


def corners_of(cells: Bool[Tensor, "*batch _ _ _"]) -> Bool[Tensor, "*batch _ _ _"]:
    """Mark the corners of the marked cells; the result has one more entry along each axis."""
    return max_of_corners(functional.pad(cells, (1,) * 6))


def with_neighbours(cells: Bool[Tensor, "*batch x y z"]) -> Bool[Tensor, "*batch x y z"]:
    """Return the marked cells together with their 26 neighbours."""
    return max_of_corners(corners_of(cells))


def divide(cells: Bool[Tensor, "_ _ _"], factor: int) -> Bool[Tensor, "_ _ _"]:
    """Return the same cells on a grid that is ``factor`` times finer along each axis."""
    for axis in range(3):
        cells = cells.repeat_interleave(factor, axis)
    return cells


def contains(
    cells: Bool[Tensor, "#objects count count count"],
    points: Float[Tensor, "objects points 3"],
    extent: Float[Tensor, "3"],
) -> Bool[Tensor, "objects points"]:
    """Mark the points that lie in a marked cell of their object.

    A point outside the box belongs to the nearest cell on its surface.

    Args:
        extent: half the size of the box, scene units.
    """
    count = cells.shape[-1]
    scale = count / (2 * extent)
    x, y, z = torch.addcmul(scale * extent, points, scale).nan_to_num_(0).clamp_(0, count - 1).floor_().unbind(-1)
    # Whole numbers, which floats hold exactly: fewer passes over memory than with integers.
    index = torch.add(z, torch.add(y, x, alpha=count), alpha=count)
    first = torch.arange(len(cells), device=index.device)[:, None] * count**3
    return cells.flatten()[(index.int() + first).flatten()].reshape(index.shape)
