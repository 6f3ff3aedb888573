"""The cells of the scene's box that any object of a model may occupy. Fits evaluate the field only there.

The densities of every training shape are evaluated at the corners of the cells. A cell is occupied if any shape is
dense enough at one of its corners. Neighbours of occupied cells are included, which leaves room for new codes: shapes
five standard deviations along a single direction stay inside.
"""

import math
from collections.abc import Generator, Iterator

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from core.models.cells import corner_points, corners_of, max_of_corners, with_neighbours
from core.models.field import Field, encode
from core.runtime.precision import autocast

CELLS = 32  # along each axis of the box
MIN_OPACITY = 0.03  # of a cell with a corner's density, below which the corner is empty
_BLOCK = 16384  # corners evaluated at a time


def cells_at_corners(
    density: Float[Tensor, "*batch all"], extent: Float[Tensor, "3"]
) -> Bool[Tensor, "*batch cells cells cells"]:
    """Mark the cells with an occupied corner; a density of NaN counts as occupied, so that the error shows.

    Args:
        density: per scene unit at all 33^3 corners, row-major.
        extent: half the size of the scene's box, scene units.
    """
    limit = -math.log1p(-MIN_OPACITY) / float(2 * extent.amin() / CELLS)
    return max_of_corners(~(density.unflatten(-1, (CELLS + 1,) * 3) <= limit))


def find_occupied_cells(
    field: Field, shapes: Float[Tensor, "shapes latent"], extent: Float[Tensor, "3"]
) -> Generator[None, None, Bool[Tensor, "cells cells cells"]]:
    """Find the cells that any of these shapes occupies, and their neighbours; seconds for a thousand shapes.

    Evaluates every second corner along each axis, then the others around occupied cells. Yields None after each shape
    of either pass and returns the cells.
    """
    with torch.no_grad():
        points = corner_points(extent, CELLS)
        first = field.point_layer(encode(points, field.config.position_frequencies)).relu()
        biases = field.shape_bias(shapes)
        coarse = torch.zeros((CELLS + 1,) * 3, dtype=torch.bool, device=first.device)
        coarse[::2, ::2, ::2] = True
        largest = torch.zeros(len(points), device=first.device)
    yield from _raise_to_densities(largest, coarse, field, first, biases)
    near = with_neighbours(cells_at_corners(largest, extent))
    yield from _raise_to_densities(largest, corners_of(near) & ~coarse, field, first, biases)
    return with_neighbours(cells_at_corners(largest, extent))


def _raise_to_densities(
    largest: Float[Tensor, "all"],
    corners: Bool[Tensor, "corners corners corners"],
    field: Field,
    first: Float[Tensor, "all width"],
    biases: Float[Tensor, "shapes blocks width"],
) -> Iterator[None]:
    """Raise ``largest``, the largest density so far at each corner, to that of these shapes at the marked corners."""
    index = corners.flatten().nonzero()[:, 0]
    activations = first[index]
    for bias in biases:
        with torch.no_grad(), autocast(first.device):
            densities = [field.density_from_activations(block, bias)[0] for block in activations.split(_BLOCK)]
            largest[index] = torch.maximum(largest[index], torch.cat(densities))
        yield None


def pack(cells: Bool[Tensor, "x y z"]) -> UInt8[Tensor, "bytes"]:
    """Pack cells as bits, eight to a byte, for model files."""
    return torch.from_numpy(np.packbits(cells.cpu().numpy(), bitorder="little"))


def unpack(packed: UInt8[Tensor, "bytes"]) -> Bool[Tensor, "cells cells cells"]:
    """Invert :func:`pack`. Raises ``ValueError`` unless there are :data:`CELLS` along each axis."""
    if packed.numel() * 8 != CELLS**3:
        raise ValueError(f"occupied cells take {CELLS**3 // 8} bytes, got {packed.numel()}")
    bits = np.unpackbits(packed.numpy(), bitorder="little").astype(bool)
    return torch.from_numpy(bits).reshape(CELLS, CELLS, CELLS)
