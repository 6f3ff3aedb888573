import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.edits.bend import Bend
from core.edits.edit import Edit
from core.edits.stretch import Stretch
from core.models.codes import CodeBook, Codes, CodeSpace, Entry, farthest_first


def cloud(seed: int = 0, count: int = 40, latent: int = 6) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([3.0, 2.0, 1.0, 0.5, 0.2, 0.1])[:latent]
    return torch.randn(count, latent, generator=generator) * scale + 1


@given(st.integers(0, 1000))
def test_coordinates_and_codes_are_converted_without_loss(seed: int):
    space = CodeSpace.from_codes(cloud(seed))
    codes = cloud(seed + 1)
    torch.testing.assert_close(space.code(space.coordinates(codes)), codes, atol=1e-4, rtol=1e-4)


def test_coordinates_of_trained_codes_have_unit_variance():
    codes = cloud(count=400)
    space = CodeSpace.from_codes(codes)
    coordinates = space.coordinates(codes)
    torch.testing.assert_close(coordinates.mean(0), torch.zeros(6), atol=1e-4, rtol=0)
    torch.testing.assert_close(coordinates.T.cov(), torch.eye(6), atol=1e-3, rtol=0)
    assert bool((space.std.diff() <= 0).all())
    space = CodeSpace.from_codes(cloud(count=4))
    assert len(space.std) == 3
    torch.testing.assert_close(space.directions @ space.directions.T, torch.eye(3), atol=1e-5, rtol=0)


def test_shape_and_texture_are_mixed_separately_and_must_be_finite():
    zeros = Codes(torch.zeros(3), torch.zeros(2))
    ones = Codes(torch.ones(3), torch.ones(2))
    assert zeros.mixed(ones, 1.0, 0.0) == Codes(torch.ones(3), torch.zeros(2))
    assert zeros.mixed(ones, 0.0, 0.5) == Codes(torch.zeros(3), torch.full((2,), 0.5))
    assert zeros.mixed(ones, 0.0, 0.0) == zeros
    with pytest.raises(ValueError, match="finite"):
        Codes(torch.tensor([torch.nan]), torch.zeros(1))


@pytest.mark.parametrize(
    ("edit", "half"),
    [
        (Stretch((3.0, 1.0, 1.0)), Stretch((2.0, 1.0, 1.0))),
        (Bend(-0.4, 0.0, 0.1, 0.4), Bend(-0.4, 0.0, 0.05, 0.4)),
    ],
)
def test_an_edit_of_the_size_goes_with_the_shape(edit: Edit, half: Edit):
    natural = Codes(torch.zeros(3), torch.zeros(2))
    sized = Codes(torch.ones(3), torch.ones(2), edits=(edit,))
    assert natural.taking("shape", sized).edits == (edit,) == sized.taking("texture", natural).edits
    assert natural.taking("texture", sized).edits == ()
    assert natural.mixed(sized, 0.5, 0.0).edits == (half,)
    assert natural.mixed(sized, 1.0, 1.0) == sized
    assert sized.mixed(natural, 1.0, 1.0) == natural
    assert sized != Codes(torch.ones(3), torch.ones(2))


def test_edits_are_ordered_and_those_that_change_nothing_are_left_out():
    stretch = Stretch((3.0, 1.0, 1.0))
    bend = Bend(-0.4, 0.0, 0.1, 0.4)
    codes = Codes(torch.ones(3), torch.ones(2), edits=(stretch, bend))
    assert codes.edits == (bend, stretch) and codes.space_edits == codes.field_edits == (bend,)
    assert codes.with_edits(Stretch, Stretch((1.0, 1.0, 1.0))).edits == (bend,)
    assert codes.with_edits(Bend, Bend(-0.4, 0.0, 0.0, 0.4)).edits == (stretch,)
    with pytest.raises(ValueError, match="at most 1 bend, got 2"):
        codes.with_edits(Bend, bend, bend)


def test_only_edits_of_the_field_belong_to_the_shape():
    plain = Codes(torch.ones(3), torch.ones(2))
    bent = plain.with_edits(Bend, Bend(-0.4, 0.0, 0.1, 0.4))
    assert bent != plain and bent.shape_key != plain.shape_key and bent.texture_key == plain.texture_key
    wide = plain.with_edits(Stretch, Stretch((3.0, 1.0, 1.0)))
    assert wide != plain and wide.shape_key == plain.shape_key
    x, y, z = wide.proportions
    assert x == pytest.approx(3 * y) and y == z and x**2 + y**2 + z**2 == pytest.approx(3)


def test_a_code_book_shares_shapes_and_samples_by_seed():
    book = CodeBook(cloud(count=2), cloud(1, count=3), (Entry("a", 0, 0), Entry("b", 0, 2)))
    assert torch.equal(book[0].shape, book[1].shape)
    assert not torch.equal(book[0].texture, book[1].texture)
    assert len(book) == 2
    for wrong in (-1, 2):
        with pytest.raises(ValueError, match="0 to 1"):
            book[wrong]
    with pytest.raises(ValueError, match="outside the book"):
        CodeBook(cloud(count=2), cloud(count=2), (Entry("a", 0, 2),))
    book = CodeBook(cloud(), cloud(1), ())
    assert book.sample(torch.Generator().manual_seed(5)) == book.sample(torch.Generator().manual_seed(5))


def test_collapsed_objects_keep_their_index_but_not_their_influence():
    """A row that a valid object shares with a collapsed one is kept."""
    shapes = cloud(count=4)
    textures = cloud(1, count=4)
    entries = (Entry("a", 0, 0), Entry("lost", 1, 0), Entry("b", 2, 2), Entry("c", 3, 3), Entry("lost too", 1, 1))
    book = CodeBook(shapes, textures, entries, frozenset({1, 4}))
    assert book.valid == (0, 2, 3)
    assert torch.equal(book[4].shape, shapes[1])
    torch.testing.assert_close(book.mean.shape, shapes[[0, 2, 3]].mean(0))
    torch.testing.assert_close(book.mean.texture, textures[[0, 2, 3]].mean(0))
    with pytest.raises(ValueError, match="collapsed objects"):
        CodeBook(shapes, textures, entries, frozenset({5}))


def test_a_code_space_created_in_inference_mode_serves_a_fit():
    book = CodeBook(cloud(), cloud(1), ())
    with torch.inference_mode():
        _ = book.mean
    coordinates = torch.zeros(3, requires_grad=True)
    book.shape_space.code(coordinates).sum().backward()
    assert coordinates.grad is not None


def test_distances_have_mean_square_one_and_the_most_different_come_first() -> None:
    rows = torch.randn(40, 6) * torch.tensor([3.0, 2, 1, 1, 0.5, 0.1]) + 5
    space = CodeSpace.from_codes(rows)
    assert float(space.distance(rows).square().mean()) == pytest.approx(39 / 40, rel=1e-3)
    assert float(space.distance(space.mean)) == 0
    assert float(space.distance(rows[3], rows[3])) == 0
    two = space.mean + 2 * space.std[0] * space.directions[0]
    assert float(space.distance(two)) == pytest.approx(2 / 6**0.5, rel=1e-4)
    points = torch.tensor([[0.0], [0.1], [10.0], [4.0], [4.0]])
    assert farthest_first(points) == [0, 2, 3, 1, 4]
    assert farthest_first(torch.empty(0, 3)) == []
