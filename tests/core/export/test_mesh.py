import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import cKDTree

from core.detail.progressive import render_frame
from core.editing.bounds import natural_bounds
from core.editing.size import sized
from core.edits.stretch import Stretch
from core.export.mesh import MeshSettings, export_mesh, extract_mesh
from core.export.surface import TOLERANCE
from core.export.triangle_mesh import Mesh
from core.geometry.camera import WORLD_FROM_GLTF, Factors
from core.models.library import load_model
from core.models.model import Instance, Model
from core.rendering import fast
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import Occupancy
from core.runtime.precision import use_dtype
from core.streams import run_to_end
from tests.conftest import unchecked_shapes
from tests.core.export.test_glb import gltf_of
from tests.core.tiny import tiny_model


@pytest.fixture(scope="module")
def tiny() -> Model:
    """The stools, ten times as dense: opaque within a cell, as trained objects are."""
    soft = tiny_model()
    field = copy.deepcopy(soft.field)
    field.config = replace(field.config, density_scale=10 * field.config.density_scale)
    return replace(soft, field=field)


def solid(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.fixture
def ball(monkeypatch: pytest.MonkeyPatch):
    """Makes every field one ball, or several: density and colour by the distance from their surfaces."""

    def make(*balls: tuple[tuple[float, float, float], float], hollow: float = 0.0) -> None:
        fast.clear_cache()

        def density(self, points):
            away = torch.stack([radius - (points - torch.tensor(middle)).norm(dim=-1) for middle, radius in balls], -1)
            outside = away.amax(-1)
            outside = torch.minimum(outside, points.norm(dim=-1) - hollow) if hollow else outside
            return torch.nn.functional.softplus(outside * 400) * 44, points

        monkeypatch.setattr(FoldedField, "first_layer", lambda self, points: points)
        monkeypatch.setattr(FoldedField, "density", density)
        monkeypatch.setattr(FoldedField, "unbounded_density", density)
        monkeypatch.setattr(FoldedField, "colour", lambda self, y, towards: (y > 0).float())

    return make


@pytest.mark.parametrize("resolution", [40, 64, 97])
def test_a_ball_has_its_volume_and_faces_outward(resolution: int, ball, model: Model):
    ball(((0.0, 0.0, 0.0), 0.2))
    mesh = run_to_end(extract_mesh(model[0], resolution))
    assert solid(mesh).is_watertight
    assert solid(mesh).is_winding_consistent
    assert solid(mesh).volume == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.06)
    outward = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert (outward * mesh.normals).sum(1).min() > 0.95
    # A colour is that of what lies below the vertex.
    clear = (np.abs(mesh.vertices) > 0.02).all(1)
    np.testing.assert_allclose(mesh.colours[clear], mesh.vertices[clear] > 0, atol=0.05)


def test_surfaces_are_closed_without_specks_and_hollows(ball, model: Model):
    ball(((0.3, 0.0, 0.0), 0.2))
    mesh = run_to_end(extract_mesh(model[0], 48))
    assert solid(mesh).is_watertight
    assert mesh.vertices[:, 0].max() == pytest.approx(model.extent[0], abs=0.02)
    ball(((0.0, 0.0, 0.0), 0.2), ((0.0, 0.2, 0.35), 0.04), ((0.2, -0.2, -0.35), 0.013), hollow=0.1)
    surface = solid(run_to_end(extract_mesh(model[0], 96)))
    pieces = surface.split(only_watertight=False)
    assert sorted(round(float(piece.extents[0]), 2) for piece in pieces) == [0.08, 0.4]
    assert surface.is_watertight


def edges_without_two_triangles(faces: np.ndarray) -> int:
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), 1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] != 2).sum())


@pytest.mark.parametrize("resolution", [16, 33])
def test_surfaces_are_closed_where_the_last_bits_of_two_evaluations_differ(
    resolution: int, ball, model: Model, monkeypatch: pytest.MonkeyPatch
):
    ball(*(((0.1 * x, 0.1 * y, 0.05 * x), 0.15) for x in range(-2, 3) for y in (-1, 1)))
    exact = FoldedField.density
    calls = iter(range(10**6))

    def density(self, points):
        value, y = exact(self, points)
        return value * (1 + 1e-6 * (next(calls) % 7)), y

    monkeypatch.setattr(FoldedField, "density", density)
    mesh = run_to_end(extract_mesh(model[0], resolution))
    assert edges_without_two_triangles(mesh.faces) == 0
    assert solid(mesh).is_winding_consistent


def test_surfaces_are_closed_where_corners_lie_on_the_surface(ball, model: Model, monkeypatch: pytest.MonkeyPatch):
    ball(((0.0, 0.0, 0.0), 0.2))
    random = torch.Generator().manual_seed(0)

    def density(self, points):
        far, outside = (torch.rand(points.shape[:-1], generator=random) < 0.5 for _ in range(2))
        near = 0.002 * (1 + torch.rand(points.shape[:-1], generator=random))
        logits = torch.where(far, 9.0, near) * torch.where(outside, -1, 1)
        return logits.exp().log1p() / (2 * max(model.extent) / 64), points

    monkeypatch.setattr(FoldedField, "density", density)
    monkeypatch.setattr(Occupancy, "contains", lambda self, points: torch.ones(points.shape[:-1]) > 0)
    for _ in range(4):
        mesh = run_to_end(extract_mesh(model[0], 20))
        assert len(mesh.faces) > 1000
        assert edges_without_two_triangles(mesh.faces) == 0


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("category", ["chairs", "cars"])
@pytest.mark.parametrize(
    ("indices", "resolutions"),
    [(range(6, 10), (32,)), pytest.param(range(100), (32, 48, 64), marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def test_every_edge_of_a_trained_object_has_two_triangles(
    category: str, dtype: torch.dtype, indices: range, resolutions: tuple[int, ...]
):
    trained = load_model(category)
    with use_dtype(dtype), unchecked_shapes():
        for index in indices:
            for resolution in resolutions:
                mesh = run_to_end(extract_mesh(trained[index], resolution))
                assert edges_without_two_triangles(mesh.faces) == 0, (index, resolution)


def test_the_mesh_covers_the_object_of_the_render(tiny: Model):
    mesh = run_to_end(extract_mesh(tiny[1], 64))
    assert solid(mesh).is_watertight
    camera = tiny.camera(1.1, 0.4)
    drawn = render_frame(tiny[1], camera)
    columns, rows = camera.project(torch.from_numpy(mesh.vertices)).long().T.numpy()
    covered = np.zeros((40, 40), bool)
    covered[rows, columns] = True
    opaque = drawn.opacity > 0.5
    assert (covered & opaque).sum() / (covered | opaque).sum() > 0.75
    # The vertices nearest to the camera have the colours of the image there.
    facing = mesh.normals @ camera.pose()[:3, 3].numpy() > 1.0
    image_colours = drawn.image[rows[facing], columns[facing]] / 255
    assert np.median(np.abs(mesh.colours[facing] - image_colours)) < 0.08


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_files_hold_the_mesh_in_their_own_axes(suffix: str, tiny: Model, tmp_path: Path):
    path = tmp_path / f"stool{suffix}"
    fractions = list(export_mesh(tiny[0], path, MeshSettings(32)))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    mesh = run_to_end(extract_mesh(tiny[0], 32))
    read = next(iter(trimesh.load_scene(path, process=False).geometry.values()))
    y_up = suffix in (".glb", ".obj")
    expected = mesh.vertices @ np.linalg.inv(WORLD_FROM_GLTF).T if y_up else mesh.vertices
    np.testing.assert_allclose(read.vertices, expected, atol=1e-6)
    assert np.array_equal(read.faces, mesh.faces)
    if suffix == ".glb":
        linear = read.visual.vertex_attributes["color"][:, :3] / 65535
        colours = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    else:
        colours = read.visual.vertex_colors[:, :3] / 255
    np.testing.assert_allclose(colours, mesh.colours, atol=3e-3)


def test_files_for_printers_are_closed_and_in_millimetres(tiny: Model, tmp_path: Path):
    for name in ("stool.stl", "stool.3mf"):
        list(export_mesh(tiny[0], tmp_path / name, MeshSettings(32, metres=0.5)))
    read = trimesh.load_mesh(tmp_path / "stool.stl")
    assert read.is_watertight and read.volume > 0
    assert (read.extents.max(), read.bounds[0, 2]) == pytest.approx((500, 0), abs=1e-2)
    printed = trimesh.load_scene(tmp_path / "stool.3mf").to_mesh()
    assert printed.is_watertight and printed.volume == pytest.approx(read.volume, rel=1e-3)


def world_vertices(path: Path) -> np.ndarray:
    """The vertices of a file in the world's axes."""
    vertices = trimesh.load_scene(path, process=False).to_geometry().vertices
    return vertices if path.suffix == ".ply" else vertices @ WORLD_FROM_GLTF.T


def seen_by_its_camera(path: Path) -> np.ndarray:
    """The places (px) at which a .glb file's camera of 96 x 64 px sees the vertices."""
    document = gltf_of(path.read_bytes())
    (node,) = (node for node in document["nodes"] if "camera" in node)
    assert document["nodes"].index(node) in document["scenes"][document["scene"]]["nodes"]
    lens = document["cameras"][node["camera"]]["perspective"]
    assert lens["aspectRatio"] == pytest.approx(96 / 64)
    points = trimesh.load_scene(path, process=False).to_geometry().vertices
    local = np.c_[points, np.ones(len(points))] @ np.linalg.inv(np.reshape(node["matrix"], (4, 4)).T).T
    slopes = local[:, :2] / -local[:, 2:3] / np.tan(lens["yfov"] / 2)  # of half the image's height, y up
    return np.c_[48 + 32 * slopes[:, 0], 32 - 32 * slopes[:, 1]]


@pytest.mark.parametrize("settings", [MeshSettings(32, metres=0.9), MeshSettings(32, texture=64), MeshSettings(32)])
def test_the_camera_of_a_glb_sees_the_object_where_the_photo_does(settings: MeshSettings, tiny: Model, tmp_path: Path):
    camera = tiny.camera(0.7, 0.4).resized(96, 64)
    list(export_mesh(tiny[0], tmp_path / "stool.glb", settings, camera))
    list(export_mesh(tiny[0], tmp_path / "plain.glb", MeshSettings(32, texture=settings.texture)))
    expected = camera.project(torch.from_numpy(world_vertices(tmp_path / "plain.glb")).float()).numpy()
    np.testing.assert_allclose(seen_by_its_camera(tmp_path / "stool.glb"), expected, atol=0.02)


def test_the_camera_of_a_sized_glb_sees_the_object_where_pictures_do(tiny: Model, tmp_path: Path):
    stool = sized(tiny[0], width=60.0, depth=40.0, height=92.0)
    camera = tiny.camera(0.7, 0.4).resized(96, 64)
    list(export_mesh(stool, tmp_path / "stool.glb", MeshSettings(32), camera))
    vertices = torch.from_numpy(run_to_end(extract_mesh(stool, 32)).vertices)
    expected = stool.local_camera(camera).project(vertices).numpy()
    projected = seen_by_its_camera(tmp_path / "stool.glb")
    np.testing.assert_allclose(projected.min(0), expected.min(0), atol=0.3)
    np.testing.assert_allclose(projected.max(0), expected.max(0), atol=0.3)


@pytest.mark.parametrize("name", ["stool.glb", "stool.ply"])
def test_a_mesh_in_metres_stands_on_the_ground(name: str, tiny: Model, tmp_path: Path):
    list(export_mesh(tiny[0], tmp_path / name, MeshSettings(32, metres=0.9)))
    low, high = np.quantile(world_vertices(tmp_path / name), (0, 1), axis=0)
    np.testing.assert_allclose((*(low + high)[:2], low[2]), 0, atol=1e-5)
    assert (high - low).max() == pytest.approx(0.9)


@pytest.mark.parametrize(("suffix", "texture"), [(".glb", 0), (".glb", 64), (".obj", 0), (".ply", 0)])
@pytest.mark.parametrize(("metres", "size"), [(None, (0.60, 0.58, 0.92)), (0.46, (0.30, 0.29, 0.46))])
def test_a_sized_object_measures_its_size(
    suffix: str, texture: int, metres: float | None, size: Factors, tiny: Model, tmp_path: Path
):
    stool = sized(tiny[0], width=60.0, depth=58.0, height=92.0)
    path = tmp_path / f"stool{suffix}"
    list(export_mesh(stool, path, MeshSettings(32, metres=metres, texture=texture)))
    np.testing.assert_allclose(np.ptp(world_vertices(path), axis=0), size, atol=1e-4)
    assert world_vertices(path)[:, 2].min() == pytest.approx(0, abs=1e-5)


def test_legs_of_a_mesh_are_as_long_as_they_were_sized(tmp_path: Path):
    chair = load_model("chairs")[999]
    split = sized(chair, width=60.0, depth=58.0, height=92.0, legs=45.0)
    with use_dtype(torch.float32):
        list(export_mesh(split, tmp_path / "chair.glb", MeshSettings(64)))
        natural = run_to_end(extract_mesh(chair, 64)).vertices
    written = world_vertices(tmp_path / "chair.glb")
    np.testing.assert_allclose(np.ptp(written, axis=0), (0.60, 0.58, 0.92), atol=1e-4)

    def underside(vertices: np.ndarray) -> float:
        """The height of the seat's underside in its middle, above the ground."""
        low = vertices.min(0)
        high = vertices.max(0)
        under = (np.abs(vertices - (low + high) / 2)[:, :2] < 0.1 * (high - low)[:2]).all(1)
        return float(np.median(np.sort(vertices[under, 2])[:20]) - low[2])

    low, high = np.quantile(natural[:, 2], (0, 1))
    seat = low + underside(natural)
    plane = natural_bounds(chair).plane
    below = 0.45 * (seat - low) / (plane - low)
    expected = below if seat < plane else 0.92 - 0.47 * (high - seat) / (high - plane)
    assert underside(written) == pytest.approx(expected, abs=2e-3)
    assert expected == pytest.approx(0.45, abs=0.01)


def test_normals_are_those_of_the_stretched_surface(tiny: Model, tmp_path: Path):
    list(export_mesh(tiny[0].with_edits(Stretch, Stretch((2.0, 1.0, 0.5))), tmp_path / "stool.ply", MeshSettings(48)))
    read = trimesh.load_mesh(tmp_path / "stool.ply", process=False)
    written = np.array(read.vertex_normals)
    np.testing.assert_allclose(np.linalg.norm(written, axis=1), 1, atol=1e-4)
    computed = trimesh.Trimesh(read.vertices, read.faces, process=False).vertex_normals
    assert np.median((written * computed).sum(1)) > 0.99


def test_a_texture_has_the_colours_of_the_vertices(tiny: Model, tmp_path: Path):
    path = tmp_path / "stool.glb"
    fractions = list(export_mesh(tiny[0], path, MeshSettings(32, texture=128)))
    assert fractions == sorted(fractions)
    (read,) = trimesh.load_scene(path, process=False).geometry.values()
    plain = run_to_end(extract_mesh(tiny[0], 32))
    image = np.asarray(read.visual.material.baseColorTexture.convert("RGB"))
    height, width = image.shape[:2]
    here = image[((1 - read.visual.uv[:, 1]) * height).astype(int), (read.visual.uv[:, 0] * width).astype(int)] / 255
    _, nearest = cKDTree(plain.vertices @ WORLD_FROM_GLTF).query(read.vertices)
    assert np.median(np.abs(here - plain.colours[nearest])) < 0.03


def test_a_cancelled_mesh_keeps_the_file_that_existed(tiny: Model, tmp_path: Path):
    path = tmp_path / "stool.glb"
    path.write_text("before")
    stream = export_mesh(tiny[0], path, MeshSettings(64))
    next(stream)
    stream.close()
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "before"


def test_wrong_settings_files_and_empty_objects_are_refused(ball, model: Model, tmp_path: Path):
    instance: Instance = model[0]
    for name, message in (("a.fbx", "glb"), ("gone/a.glb", "cannot write")):
        with pytest.raises(ValueError, match=message):
            list(export_mesh(instance, tmp_path / name, MeshSettings(16)))
    for resolution in (7, 5000):
        with pytest.raises(ValueError, match="8 to 1024"):
            list(export_mesh(instance, tmp_path / "a.glb", MeshSettings(resolution)))
    with pytest.raises(ValueError, match="holds a texture"):
        list(export_mesh(instance, tmp_path / "a.ply", MeshSettings(16, texture=64)))
    for wrong in ({"metres": 0.0}, {"texture": 4}, {"triangles": 3}):
        with pytest.raises(ValueError, match="got"):
            MeshSettings(**wrong)
    ball(((0.0, 0.0, 0.0), -1.0))
    with pytest.raises(ValueError, match="no surface"):
        list(export_mesh(instance, tmp_path / "a.glb", MeshSettings(16)))
    assert list(tmp_path.iterdir()) == []


def test_a_mesh_has_as_many_cells_as_its_surface_needs(ball, model: Model):
    ball(((0.0, 0.0, 0.0), 0.2))
    fine = run_to_end(extract_mesh(model[0], 384))
    mesh = run_to_end(extract_mesh(model[0]))
    radius = np.median(np.linalg.norm(fine.vertices, axis=1))
    middles = mesh.vertices[mesh.faces].mean(1)
    assert np.quantile(np.abs(np.linalg.norm(middles, axis=1) - radius), 0.95) < TOLERANCE
    assert len(mesh.faces) < len(fine.faces) / 3
    # Something thinner than the coarsest grid's cells is found all the same.
    ball(((0.0, 0.0, 0.0), 0.2), *(((0.21 + 0.006 * step, 0.0, 0.0), 0.006) for step in range(15)))
    assert run_to_end(extract_mesh(model[0])).vertices[:, 0].max() == pytest.approx(0.298, abs=0.005)
