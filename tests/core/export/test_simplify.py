from pathlib import Path

import lib3mf
import numpy as np
import pytest
import trimesh

from core.export.mesh import extract_mesh
from core.export.mesh_formats import save_mesh
from core.export.simplify import simplify
from core.export.triangle_mesh import Mesh
from core.models.library import load_model
from core.models.model import Model
from core.streams import run_to_end
from tests.core.export.test_mesh import edges_without_two_triangles

_RESOLUTION = 32
_SIZES = 100, 400, 1500, 4000


@pytest.fixture(scope="module", params=["chairs", "cars"])
def meshes(request: pytest.FixtureRequest) -> list[Mesh]:
    """Ten objects of a shipped model."""
    model: Model = load_model(request.param)
    return [run_to_end(extract_mesh(model[index], _RESOLUTION)) for index in range(10)]


def bodies(vertices: np.ndarray, faces: np.ndarray) -> int:
    return trimesh.Trimesh(vertices, faces, process=False).body_count


@pytest.mark.parametrize("triangles", _SIZES)
def test_a_surface_of_any_size_is_closed_and_has_all_its_bodies(meshes: list[Mesh], triangles: int) -> None:
    for mesh in meshes:
        vertices, faces = run_to_end(simplify(mesh.vertices, mesh.faces, triangles))
        assert len(faces) <= max(triangles, 4 * bodies(mesh.vertices, mesh.faces)) or len(faces) == len(mesh.faces)
        assert edges_without_two_triangles(faces) == 0
        assert len(np.unique(np.sort(faces, 1), axis=0)) == len(faces)
        assert bodies(vertices, faces) == bodies(mesh.vertices, mesh.faces)
        assert len(np.unique(vertices, axis=0)) == len(vertices)
        assert trimesh.Trimesh(vertices, faces, process=False).is_winding_consistent


def read_by_lib3mf(path: Path) -> list[lib3mf.MeshObject]:
    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader(path.suffix[1:]).ReadFromFile(str(path))
    iterator = model.GetMeshObjects()
    objects = []
    while iterator.MoveNext():
        objects.append(iterator.GetCurrentMeshObject())
    return objects


@pytest.mark.parametrize("suffix", [".stl", ".3mf"])
@pytest.mark.parametrize("triangles", _SIZES)
def test_two_other_readers_find_a_closed_surface_in_files_for_printers(
    meshes: list[Mesh], triangles: int, suffix: str, tmp_path: Path
) -> None:
    mesh = meshes[0]
    path = tmp_path / f"chair{suffix}"
    vertices, faces = run_to_end(simplify(mesh.vertices, mesh.faces, triangles))
    save_mesh(Mesh(vertices, np.zeros_like(vertices), faces, (("chair", len(faces)),), np.zeros_like(vertices)), path)
    read = trimesh.load_scene(path).to_mesh()
    read.merge_vertices()
    assert read.is_watertight
    assert read.body_count == bodies(mesh.vertices, mesh.faces)
    (printed,) = read_by_lib3mf(path)
    assert printed.IsManifoldAndOriented()
    assert printed.GetTriangleCount() == len(faces)


def test_a_tetrahedron_is_not_simplified() -> None:
    body = trimesh.creation.icosphere(2)
    both = trimesh.util.concatenate((body, body.copy().apply_translation((3, 0, 0))))
    vertices, faces = run_to_end(simplify(np.array(both.vertices), np.array(both.faces), 1))
    assert bodies(vertices, faces) == 2
    assert len(faces) >= 8
