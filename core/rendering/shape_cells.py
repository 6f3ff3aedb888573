"""The cells of the scene's box that single shapes occupy: what is asked often pays for finding them first."""

from functools import lru_cache

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from core.models.model import Model
from core.models.occupied_cells import CELLS, cells_at_corners, corners, with_neighbours
from core.rendering.folded_field import batch_density


@torch.no_grad()
def shape_cells(
    model: Model, shape_bias: Float[Tensor, "objects blocks modulation"]
) -> Bool[Tensor, "objects x y z"] | None:
    """The cells that each shape may occupy, a margin of one cell included; None where ``model.occupied_cells`` is.

    Of those that training objects occupy: as many evaluations as these have corners.
    """
    if model.occupied_cells is None:
        return None
    index, points = _corners(model)
    found = batch_density(model, points.expand(len(shape_bias), -1, -1), shape_bias)
    density = found.new_zeros(len(found), (CELLS + 1) ** 3).index_copy_(1, index, found)
    cells = with_neighbours(cells_at_corners(density, model.extent_tensor))
    return cells & model.occupied_cells.to(cells.device)


@lru_cache(maxsize=2)
def _corners(model: Model) -> tuple[Int[Tensor, "some"], Float[Tensor, "some 3"]]:
    """The corners of the cells that training objects occupy: which of all, and where."""
    assert model.occupied_cells is not None
    cells = functional.pad(model.occupied_cells[None].float(), (1,) * 6)
    index = (functional.max_pool3d(cells, 2, 1)[0] > 0).flatten().nonzero()[:, 0].to(model.device)
    return index, corners(model.extent_tensor)[index]
