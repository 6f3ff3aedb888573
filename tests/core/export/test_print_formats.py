import zipfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import lib3mf
import numpy as np
import pytest
import trimesh

from core.export.mesh import MeshSettings, export_mesh, extract_mesh
from core.export.print_formats import leg_thickness, write_3mf
from core.export.triangle_mesh import Mesh
from core.models.library import load_model
from core.streams import run_to_end

_CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
_SLIC3R = "{http://schemas.slic3r.org/3mf/2017/06}"

_UNKNOWN_ATTRIBUTE = 32935  # lib3mf's number: slicers alone know the attribute of a filament


@pytest.fixture(scope="module")
def chair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Mesh, Path, ElementTree.Element]:
    """A mesh, its file, and the root of the file's model."""
    path = tmp_path_factory.mktemp("print") / "chair.3mf"
    mesh = run_to_end(extract_mesh(load_model("chairs")[999], 48))
    write_3mf(mesh, path)
    with zipfile.ZipFile(path) as file:
        return mesh, path, ElementTree.fromstring(file.read("3D/3dmodel.model"))


def test_a_3mf_is_one_closed_object_with_a_filament_for_each_part(chair: tuple[Mesh, Path, ElementTree.Element]):
    mesh, path, root = chair
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.ReadFromFile(str(path))
    assert {reader.GetWarning(number)[0] for number in range(reader.GetWarningCount())} <= {_UNKNOWN_ATTRIBUTE}
    assert (model.GetMeshObjects().Count(), model.GetBuildItems().Count()) == (1, 1)
    assert [base.get("name") for base in root.iter(f"{_CORE}base")] == [name for name, _ in mesh.part_counts]
    triangles = [*root.iter(f"{_CORE}triangle")]
    counts = Counter(int(triangle.get("p1", "")) for triangle in triangles)
    assert [counts[number] for number in range(len(mesh.part_counts))] == [count for _, count in mesh.part_counts]
    codes = [(triangle.get(f"{_SLIC3R}mmu_segmentation"), triangle.get("paint_color")) for triangle in triangles]
    assert [*dict.fromkeys(codes)] == [(code, code) for code in ("4", "8", "0C", "1C")[: len(counts)]]
    assert len(counts) >= 3


def test_a_part_has_the_mean_colour_of_its_surface(chair: tuple[Mesh, Path, ElementTree.Element]):
    mesh, _, root = chair
    for base, (_, piece) in zip(root.iter(f"{_CORE}base"), mesh.parts(), strict=True):
        rgb = np.array([*bytes.fromhex(base.get("displaycolor", "")[1:])]) / 255
        areas = trimesh.Trimesh(piece.vertices, piece.faces, process=False).area_faces
        mean = np.average(piece.colours[piece.faces].mean(1), axis=0, weights=areas)
        np.testing.assert_allclose(rgb, mean, atol=0.01)


@pytest.mark.parametrize(("shape", "metres"), [("round", 0.0010), ("square", 0.0007)])
def test_legs_are_as_thick_as_their_thinnest_section(shape: str, metres: float):
    height = 0.03
    if shape == "round":
        leg = trimesh.creation.cylinder(metres / 2, height, sections=64)
    else:
        leg = trimesh.creation.box((metres, metres, height))
    legs = trimesh.util.concatenate([leg.copy().apply_translation((x, y, 0)) for x in (0, 0.02) for y in (0, 0.02)])
    seat = trimesh.creation.box((0.03, 0.03, 0.004))
    both = trimesh.util.concatenate((seat, legs))
    counts = ("seat", len(seat.faces)), ("legs", len(legs.faces))
    mesh = Mesh(both.vertices, both.vertex_normals, both.faces, counts)
    assert leg_thickness(mesh) == pytest.approx(1000 * metres, rel=0.02)
    assert leg_thickness(Mesh(seat.vertices, seat.vertex_normals, seat.faces, counts[:1])) is None


@pytest.mark.parametrize(("metres", "is_thin"), [(0.02, True), (1.0, False)])
def test_a_file_for_printers_comes_with_a_doubt_where_legs_are_thin(metres: float, is_thin: bool, tmp_path: Path):
    chair = load_model("chairs")[999]
    doubt = run_to_end(export_mesh(chair, tmp_path / "chair.stl", MeshSettings(64, metres=metres)))
    assert ("legs are about" in doubt) == is_thin
    assert not run_to_end(export_mesh(chair, tmp_path / "chair.ply", MeshSettings(64, metres=metres)))
