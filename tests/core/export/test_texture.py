import json
import struct
from collections.abc import Generator
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from core.export.texture import TexturedMesh, textured


def by_place(places: np.ndarray, normals: np.ndarray) -> Generator[float, None, np.ndarray]:
    """Colours that tell where they were asked for."""
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    yield 0.5
    return 0.5 + 0.5 * places


@pytest.fixture(scope="module")
def ball() -> tuple[TexturedMesh, list[float]]:
    whole, shares = trimesh.creation.icosphere(4), []
    stream = textured(whole.vertices, whole.faces, (("ball", len(whole.faces)),), by_place, 256)
    while True:
        try:
            shares.append(next(stream))
        except StopIteration as done:
            return done.value, shares


def test_every_place_has_its_colour_and_seams_do_not_show(ball: tuple[TexturedMesh, list[float]]):
    found, shares = ball
    assert all(before <= after for before, after in pairwise(shares))
    height, width = found.image.shape[:2]
    assert 200 < width < 400
    rng = np.random.default_rng(0)
    weights = rng.dirichlet((1, 1, 1), len(found.faces))[..., None]
    places, uv = ((weights * array[found.faces]).sum(1) for array in (found.vertices, found.uv))
    row, column = ((1 - uv[:, 1]) * height).astype(int), (uv[:, 0] * width).astype(int)
    assert np.abs(found.image[row, column] / 255 - (0.5 + 0.5 * places)).max() < 0.05
    found, _ = ball
    assert (found.normals * found.vertices).sum(1).min() > 0.99
    assert len(found.vertices) > len(np.unique(found.vertices.round(5), axis=0))  # there are seams


def test_the_file_is_unlit_and_comes_back_with_its_image(ball: tuple[TexturedMesh, list[float]]):
    found, _ = ball
    written = found.glb()
    (length,) = struct.unpack("<I", written[12:16])
    about = json.loads(written[20 : 20 + length])
    assert about["extensionsUsed"] == ["KHR_materials_unlit"]
    assert about["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    (read,) = trimesh.load_scene(trimesh.util.wrap_as_stream(written), "glb", process=False).geometry.values()
    np.testing.assert_allclose(read.vertices, found.vertices, atol=1e-6)
    np.testing.assert_allclose(read.visual.uv, found.uv, atol=1e-6)
    image = np.asarray(read.visual.material.baseColorTexture.convert("RGB"))
    np.testing.assert_array_equal(image, found.image)
