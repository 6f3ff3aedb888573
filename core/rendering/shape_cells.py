"""Occupied cells of single shapes, on the grid of :mod:`core.models.occupied_cells`.

Fits compute them for shapes that many rays will sample.
"""

from functools import lru_cache

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.models.cells import corner_points, corners_of, with_neighbours
from core.models.model import Model
from core.models.occupied_cells import CELLS, cells_at_corners
from core.rendering.folded_layers import batch_density


@torch.no_grad()
def shape_cells(
    model: Model, shape_bias: Float[Tensor, "objects blocks width"]
) -> Bool[Tensor, "objects x y z"] | None:
    """Return the cells that each shape may occupy, with a margin of one cell.

    They are a subset of ``model.occupied_cells``; None if the model has none.
    """
    if model.occupied_cells is None:
        return None
    index, points = _corners(model)
    density = batch_density(model, points.expand(len(shape_bias), -1, -1), shape_bias)
    on_grid = density.new_zeros(len(density), (CELLS + 1) ** 3).index_copy_(1, index, density)
    cells = with_neighbours(cells_at_corners(on_grid, model.extent_tensor))
    return cells & model.occupied_cells.to(cells.device)


@lru_cache(maxsize=2)
def _corners(model: Model) -> tuple[Int[Tensor, "corners"], Float[Tensor, "corners 3"]]:
    """Return the indices (row-major) and positions of the corners of ``model.occupied_cells``."""
    assert model.occupied_cells is not None
    index = corners_of(model.occupied_cells).flatten().nonzero()[:, 0].to(model.device)
    return index, corner_points(model.extent_tensor, CELLS)[index]
