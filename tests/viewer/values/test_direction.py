import pytest
import torch

from core.models.model import Model
from viewer.values.direction import Direction
from viewer.values.part import PARTS, Part


@pytest.mark.parametrize("part", PARTS)
def test_a_principal_one_sets_a_coordinate_of_one_code_alone(model: Model, part: Part) -> None:
    book, codes = model.codes, model.codes[2]
    direction = Direction.principal(book, part, 1)
    space = book.shape_space if part == "shape" else book.texture_space
    before, other = space.coordinates(getattr(codes, part)), "texture" if part == "shape" else "shape"
    assert direction.part == part
    assert direction.strength(codes, book.mean) == pytest.approx(float(before[1]), abs=1e-4)
    moved = direction.moved(codes, book.mean, 1.5)
    after = space.coordinates(getattr(moved, part))
    expected = before.clone()
    expected[1] = 1.5
    torch.testing.assert_close(after, expected, atol=1e-3, rtol=1e-3)
    assert getattr(moved, other) is getattr(codes, other)
