import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.editing.size import with_side
from core.edits.bend import Bend
from core.models.codes import MAX_DISTORTION, CodeBook, Codes, CodeSpace, Entry, farthest_first

_STRETCHES = st.tuples(*[st.floats(0.5, 4.0)] * 3)


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


def test_a_stretch_goes_with_the_shape():
    natural = Codes(torch.zeros(3), torch.zeros(2))
    wide = Codes(torch.ones(3), torch.ones(2), stretch=(3.0, 1.0, 1.0))
    assert natural.taking("shape", wide).stretch == wide.stretch == wide.taking("texture", natural).stretch
    assert natural.taking("texture", wide).stretch is None
    assert natural.mixed(wide, 0.5, 0.0).stretch == (2.0, 1.0, 1.0)
    assert natural.mixed(wide, 1.0, 1.0) == wide
    assert wide.mixed(natural, 1.0, 1.0) == natural
    assert natural == Codes(torch.zeros(3), torch.zeros(2), stretch=(1.0, 1.0, 1.0))
    assert wide != Codes(torch.ones(3), torch.ones(2))
    x, y, z = wide.proportions
    assert x == pytest.approx(3 * y) and y == z and x**2 + y**2 + z**2 == pytest.approx(3)


def test_a_bend_goes_with_the_shape_and_belongs_to_it():
    natural = Codes(torch.zeros(3), torch.zeros(2))
    bend = Bend(-0.4, 0.0, 0.1, 0.4)
    tall = Codes(torch.ones(3), torch.ones(2), bend=bend)
    assert natural.taking("shape", tall).bend == bend == tall.taking("texture", natural).bend
    assert natural.taking("texture", tall).bend is None
    assert natural.mixed(tall, 0.5, 0.0).bend == Bend(-0.4, 0.0, 0.05, 0.4)
    assert natural.mixed(tall, 1.0, 1.0) == tall
    assert tall.mixed(natural, 1.0, 1.0) == natural
    unbent = Codes(torch.ones(3), torch.ones(2))
    assert tall != unbent and tall.shape_key != unbent.shape_key and tall.texture_key == unbent.texture_key
    assert unbent == Codes(torch.ones(3), torch.ones(2), bend=Bend(-0.4, 0.0, 0.0, 0.4))
    assert tall.is_sized and not unbent.is_sized


@pytest.mark.parametrize("stretch", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (torch.nan,) * 3, (1e3,) * 3, (1.0, 20.0, 1.0)])
def test_other_stretches_are_refused(stretch: tuple[float, float, float]):
    with pytest.raises(ValueError, match="times"):
        Codes(torch.zeros(3), torch.zeros(2), stretch=stretch)


@given(_STRETCHES, _STRETCHES, st.integers(0, 2), st.floats(0, 1), st.sampled_from((1e-9, 1e9)))
def test_stretches_made_from_others_at_their_limits_are_valid(
    first: tuple[float, float, float], second: tuple[float, float, float], axis: int, amount: float, factor: float
) -> None:
    stretches = (with_side(stretch, axis, factor) for stretch in (first, second))
    ends = [Codes(torch.zeros(1), torch.zeros(1), stretch=stretch) for stretch in stretches]
    mixed = ends[0].mixed(ends[1], amount, 0.0).stretch
    assert mixed is not None and max(mixed) <= 1.00001 * MAX_DISTORTION * min(mixed)


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
