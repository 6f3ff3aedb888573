"""The cells that objects may occupy: right for objects that were trained on, with room for new ones."""

from functools import cache

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from core.models.cells import corner_points
from core.models.library import load_model
from core.models.model import Model
from core.models.occupied_cells import CELLS, MIN_OPACITY, cells_at_corners, pack, unpack
from core.runtime.precision import autocast
from tests.core.tiny import EXTENT, tiny_model

_EXTENT = torch.tensor(EXTENT)


def test_a_cell_with_an_occupied_corner_is_occupied_and_other_sizes_are_refused():
    density = torch.zeros((CELLS + 1) ** 3)
    density[(CELLS + 1) ** 2 * 5 + (CELLS + 1) * 7 + 9] = 1e3
    cells = cells_at_corners(density, _EXTENT)
    assert cells.nonzero().tolist() == [[x, y, z] for x in (4, 5) for y in (6, 7) for z in (8, 9)]
    with pytest.raises(ValueError, match="4096 bytes"):
        unpack(torch.zeros(12, dtype=torch.uint8))


@given(st.integers(0, 2**31))
def test_cells_survive_packing(seed: int):
    cells = torch.rand((CELLS, CELLS, CELLS), generator=torch.Generator().manual_seed(seed)) > 0.7
    assert torch.equal(unpack(pack(cells)), cells)


def _outside(model: Model, code: torch.Tensor) -> float:
    """Return the fraction of the box that a shape occupies beyond the model's cells."""
    assert model.occupied_cells is not None
    with torch.no_grad(), autocast(model.device):
        density = model.field.density(corner_points(model.extent_tensor, CELLS), model.field.shape_bias(code))[0]
    return float((cells_at_corners(density, model.extent_tensor) & ~model.occupied_cells).float().mean())


def test_occupied_cells_hold_all_training_objects():
    model = tiny_model()
    assert 0.05 < float(model.occupied_cells.float().mean()) < 0.8
    assert all(_outside(model, shape) == 0 for shape in model.codes.shapes)
    assert 0 < MIN_OPACITY < 0.1


@pytest.mark.parametrize("name", ["chairs", "cars"])
@settings(max_examples=12)
@given(seed=st.integers(0, 2**31))
def test_occupied_cells_hold_shapes_of_five_standard_deviations(name: str, seed: int):
    model = _shipped(name)
    generator = torch.Generator().manual_seed(seed)
    space = model.codes.shape_space
    direction = int(torch.randint(len(space.std), (), generator=generator))
    deviations = torch.zeros(len(space.std))
    deviations[direction] = 10 * float(torch.rand((), generator=generator)) - 5
    assert _outside(model, space.code(deviations)) < 1e-3
    assert _outside(model, space.code(torch.randn(len(space.std), generator=generator))) < 1e-3


_shipped = cache(load_model)
