import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.lab.datasets.mesh_variants import deformed, pairs, recoloured
from core.lab.datasets.rasteriser import Surface


def _box() -> Surface:
    corners = np.array([(x, y, z) for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    faces = np.array([(0, 1, 3), (4, 7, 5), (0, 5, 1), (2, 3, 7)])
    colours = np.where(corners[:, 2:] > 0, (0.8, 0.1, 0.1), (0.05, 0.05, 0.05))
    return Surface(corners, corners / 3**0.5, faces, colours)


@given(st.integers(0, 6))
def test_cells_are_distinct_and_form_one_connected_half_of_the_table(variants: int) -> None:
    filled = pairs(variants)
    shapes = {shape for shape, _ in filled}
    colourings = {colouring for _, colouring in filled}
    assert len(set(filled)) == len(filled)
    assert filled[0] == (0, 0)
    assert shapes == set(range(variants + 1))
    reached = {0}
    for _ in filled:
        reached_colourings = {colouring for shape, colouring in filled if shape in reached}
        reached = {shape for shape, colouring in filled if colouring in reached_colourings}
    assert reached == shapes
    if 3 <= variants <= 5:
        assert 0.3 <= len(filled) / (len(shapes) * len(colourings)) <= 0.6


def test_variants_repeat_keep_sides_alike_and_begin_with_the_mesh_itself() -> None:
    assert deformed([_box()], "a", 0)[0] is not None
    np.testing.assert_array_equal(deformed([_box()], "a", 0)[0].vertices, _box().vertices)
    np.testing.assert_array_equal(recoloured([_box()], "a", 0)[0].colours, _box().colours)
    first, again = (deformed([_box()], "a", 2)[0].vertices for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, _box().vertices)
    np.testing.assert_allclose(np.abs(first[:4, 0]), np.abs(first[4:, 0]))
    assert not np.allclose(first, deformed([_box()], "a", 1)[0].vertices)


def test_a_recolouring_is_the_same_on_every_shape() -> None:
    plain = recoloured([_box()], "a", 1)[0]
    bent = deformed([plain], "a", 2)[0]
    np.testing.assert_array_equal(plain.colours, bent.colours)
    assert not np.allclose(plain.colours, _box().colours)


def test_a_textured_surface_is_repainted_in_its_texture() -> None:
    box = _box()
    image = np.full((4, 4, 4), 255, np.uint8)
    image[:2, :, :3] = (200, 30, 30)
    uvs = np.random.default_rng(0).random((8, 2))
    textured = Surface(box.vertices, box.normals, box.faces, np.full((8, 3), 0.5), uvs, image)
    fresh = recoloured([textured], "a", 1)[0]
    assert (fresh.colours == 1).all()
    assert not np.array_equal(fresh.texture[..., :3], image[..., :3] // 2)
    assert (fresh.texture[..., 3] == 255).all()
