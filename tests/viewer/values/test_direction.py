from dataclasses import replace

import pytest
import torch

from core.models.codes import Codes
from core.models.model import Model
from viewer.values.direction import Direction
from viewer.values.part import PARTS, Part


@pytest.mark.parametrize("part", PARTS)
def test_a_principal_one_sets_a_coordinate_of_one_code_alone(model: Model, part: Part) -> None:
    book, codes = model.codes, model.codes[2]
    direction = Direction.principal(book, part, 1)
    space = book.shape_space if part == "shape" else book.texture_space
    before, other = space.coordinates(getattr(codes, part)), "texture" if part == "shape" else "shape"
    assert direction.parts == (part,)
    assert direction.strength(codes, book.mean) == pytest.approx(float(before[1]), abs=1e-4)
    moved = direction.moved(codes, book.mean, 1.5)
    after = space.coordinates(getattr(moved, part))
    expected = before.clone()
    expected[1] = 1.5
    torch.testing.assert_close(after, expected, atol=1e-3, rtol=1e-3)
    assert getattr(moved, other) is getattr(codes, other)


@pytest.mark.parametrize("part", PARTS)
def test_the_way_between_two_objects_leads_from_one_to_the_other(model: Model, part: Part) -> None:
    book, first, second = model.codes, model.codes[1], model.codes[3]
    direction = Direction.between("more legs", book, (first, second), (part,))
    end = direction.strength(second, book.mean)
    assert end > direction.strength(first, book.mean)
    moved = direction.moved(first, book.mean, end)
    torch.testing.assert_close(getattr(moved, part), getattr(second, part), atol=1e-4, rtol=1e-3)
    deviation = torch.stack([getattr(book[index], part) for index in book.valid])
    unit = torch.nn.functional.normalize(getattr(direction.step, part), dim=0)
    assert float(getattr(direction.step, part).norm()) == pytest.approx(float((deviation @ unit).std()), rel=1e-3)


def test_of_both_codes_each_moves_by_as_many_deviations(model: Model) -> None:
    book, first = model.codes, model.codes[1]
    direction = Direction.between("sportier", book, (first, model.codes[3]), PARTS)
    to = direction.strength(first, book.mean) + 2.0
    moved = direction.moved(first, book.mean, to)
    assert direction.strength(moved, book.mean) == pytest.approx(to, abs=1e-3)
    for part in PARTS:
        by = getattr(moved, part) - getattr(first, part)
        torch.testing.assert_close(by, 2.0 * getattr(direction.step, part), atol=1e-4, rtol=1e-3)


def test_equal_objects_have_no_way_between_them(model: Model) -> None:
    first, second = model.codes[1], model.codes[3]
    with pytest.raises(ValueError, match="both have the same shape and texture"):
        Direction.between("none", model.codes, (first, first), PARTS)
    with pytest.raises(ValueError, match=r"both have the same shape$"):
        Direction.between("none", model.codes, (first, Codes(first.shape, second.texture)), ("shape",))
    one = Direction.between("colour", model.codes, (first, replace(first, texture=second.texture)), PARTS)
    assert one.parts == ("texture",)
