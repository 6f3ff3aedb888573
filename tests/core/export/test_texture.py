from collections.abc import Generator

import numpy as np
import pytest
import trimesh

from core.export.glb import glb
from core.export.texture import textured
from core.export.triangle_mesh import Mesh
from tests.core.export.test_glb import gltf_of


def by_position(points: np.ndarray, normals: np.ndarray) -> Generator[float, None, np.ndarray]:
    """Colours that encode their positions."""
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    yield 0.5
    return 0.5 + 0.5 * points


@pytest.fixture(scope="module")
def ball() -> tuple[Mesh, list[float]]:
    sphere = trimesh.creation.icosphere(4)
    fractions = []
    bare = Mesh(np.array(sphere.vertices), np.array(sphere.vertices), sphere.faces, (("ball", len(sphere.faces)),))
    stream = textured(bare, {"": by_position}, 256)
    while True:
        try:
            fractions.append(next(stream))
        except StopIteration as done:
            return done.value, fractions


def test_every_place_has_its_colour_and_seams_do_not_show(ball: tuple[Mesh, list[float]]):
    mesh, fractions = ball
    assert fractions == sorted(fractions)
    height, width = mesh.images[""].shape[:2]
    assert 200 < width < 400
    rng = np.random.default_rng(0)
    weights = rng.dirichlet((1, 1, 1), len(mesh.faces))[..., None]
    points, uv = ((weights * array[mesh.faces]).sum(1) for array in (mesh.vertices, mesh.uv))
    row = ((1 - uv[:, 1]) * height).astype(int)
    column = (uv[:, 0] * width).astype(int)
    assert np.abs(mesh.images[""][row, column] / 255 - (0.5 + 0.5 * points)).max() < 0.05
    assert (mesh.normals * mesh.vertices).sum(1).min() > 0.99
    assert len(mesh.vertices) > len(np.unique(mesh.vertices.round(5), axis=0))  # there are seams


def test_textured_files_are_unlit_and_keep_their_image(ball: tuple[Mesh, list[float]]):
    mesh, _ = ball
    written = glb(mesh)
    document = gltf_of(written)
    assert document["extensionsUsed"] == ["KHR_materials_unlit"]
    assert document["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    (read,) = trimesh.load_scene(trimesh.util.wrap_as_stream(written), "glb", process=False).geometry.values()
    np.testing.assert_allclose(read.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_allclose(read.visual.uv, mesh.uv, atol=1e-6)
    image = np.asarray(read.visual.material.baseColorTexture.convert("RGB"))
    np.testing.assert_array_equal(image, mesh.images[""])
