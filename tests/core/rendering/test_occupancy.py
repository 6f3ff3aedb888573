"""Pieces that lie apart from an object."""

import torch

from core.models.model import Model
from core.rendering.occupancy import CELLS, without_pieces


def test_small_pieces_that_lie_apart_vanish_and_thin_connected_parts_stay(tiny: Model) -> None:
    """A block with a thin leg, a crumb with fog around it, and a second block."""
    densities = torch.zeros((CELLS + 1,) * 3)
    densities[10:30, 10:30, 10:30] = 200.0
    densities[20, 20, 4:10] = 20.0
    densities[40:60, 10:30, 10:30] = 200.0
    expected = densities.clone()
    densities[49:54, 49:54, 49:54] = 0.1
    densities[50:53, 50:53, 50:53] = 200.0
    assert torch.equal(without_pieces(densities, tiny), expected)
    assert torch.equal(without_pieces(expected, tiny), expected)
    empty = torch.zeros_like(densities)
    assert torch.equal(without_pieces(empty, tiny), empty)
