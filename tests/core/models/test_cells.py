"""Cells, corners and neighbours against the plain definitions; points lie in their own cells."""

import itertools

import torch
from hypothesis import given
from hypothesis import strategies as st

from core.models.cells import contains, corner_points, corners_of, divide, max_of_corners, unravelled, with_neighbours

_COUNT = 12
_EXTENT = torch.tensor([0.4, 0.2, 0.3])


def test_corners_are_between_faces_row_by_row_and_cells_take_their_largest():
    corners = corner_points(_EXTENT, _COUNT).reshape(*[_COUNT + 1] * 3, 3)
    torch.testing.assert_close(corners[0, 0, 0], -_EXTENT)
    torch.testing.assert_close(corners[-1, 6, 0], _EXTENT * torch.tensor([1, 0, -1]))
    corners = torch.randn((4, 3, 5), generator=torch.Generator().manual_seed(0))
    largest = max_of_corners(corners)
    for x, y, z in itertools.product(range(3), range(2), range(4)):
        assert largest[x, y, z] == corners[x : x + 2, y : y + 2, z : z + 2].amax()
    index = torch.randint(0, 7**3, (50,), generator=torch.Generator().manual_seed(0))
    assert torch.equal(unravelled(index, 7), torch.stack(torch.unravel_index(index, (7, 7, 7)), -1))


@given(st.integers(0, 2**31))
def test_corners_and_neighbours_are_those_that_touch(seed: int):
    cells = torch.rand((2, 5, 4, 3), generator=torch.Generator().manual_seed(seed)) > 0.9
    corners = torch.zeros((2, 6, 5, 4), dtype=torch.bool)
    near = torch.zeros_like(cells)
    for item, x, y, z in cells.nonzero().tolist():
        corners[item, x : x + 2, y : y + 2, z : z + 2] = True
        near[item, max(0, x - 1) : x + 2, max(0, y - 1) : y + 2, max(0, z - 1) : z + 2] = True
    assert torch.equal(corners_of(cells), corners)
    assert torch.equal(with_neighbours(cells), near)


def test_divided_cells_cover_the_same_volume():
    cells = torch.rand((4, 4, 4), generator=torch.Generator().manual_seed(0)) > 0.5
    finer = divide(cells, 3)
    assert torch.equal(finer[1::3, 1::3, 1::3], cells)
    assert int(finer.sum()) == 27 * int(cells.sum())


def test_points_are_found_in_their_own_cells_and_outside_in_those_beside():
    generator = torch.Generator().manual_seed(0)
    cells = torch.rand((2, _COUNT, _COUNT, _COUNT), generator=generator) > 0.5
    points = (torch.rand((2, 200, 3), generator=generator) * 2 - 1) * _EXTENT
    inside = contains(cells, points, _EXTENT)
    for object_cells, object_points, expected in zip(cells, points, inside, strict=True):
        x, y, z = ((object_points / _EXTENT + 1) / 2 * _COUNT).long().T
        assert torch.equal(object_cells[x, y, z], expected)
    assert torch.equal(contains(cells[:1], points, _EXTENT)[0], inside[0])
    cells = torch.zeros((1, _COUNT, _COUNT, _COUNT), dtype=torch.bool)
    cells[0, 0, 0, -1] = True
    assert contains(cells, torch.tensor([[[-9.0, -9.0, 9.0], [-9.0, -9.0, -9.0]]]), _EXTENT).tolist() == [[True, False]]
