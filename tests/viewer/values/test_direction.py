import pytest

from core.models.codes import CODE_KINDS, CodeKind
from core.models.model import Model
from viewer.values.direction import Direction


@pytest.mark.parametrize("kind", CODE_KINDS)
def test_a_principal_direction_sets_one_coordinate_of_one_code(model: Model, kind: CodeKind) -> None:
    book = model.codes
    instance = model[2]
    direction = Direction.principal(book, kind, 1)
    space = book.shape_space if kind == "shape" else book.texture_space
    coordinates = space.coordinates(getattr(instance.codes, kind))
    other_kind = "texture" if kind == "shape" else "shape"
    assert direction.kind == kind
    assert direction.strength(instance) == pytest.approx(float(coordinates[1]), abs=1e-4)
    to = float(coordinates[1]) + 0.5
    moved = direction.moved(instance, to)
    strengths = [Direction.principal(book, kind, index).strength(moved) for index in range(len(coordinates))]
    expected = coordinates.tolist()
    expected[1] = to
    assert strengths == pytest.approx(expected, abs=1e-3)
    assert getattr(moved.codes, other_kind) is getattr(instance.codes, other_kind)
