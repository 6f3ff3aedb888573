from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from core.export.mesh import MeshSettings, export_mesh, extract_mesh
from core.export.triangle_mesh import Mesh
from core.geometry.camera import WORLD_FROM_GLTF
from core.models.library import load_model
from core.models.model import Model
from core.models.part_head import PartHead
from core.streams import run_to_end


@pytest.fixture(scope="module")
def car() -> tuple[Model, Mesh]:
    cars = load_model("cars")
    return cars, run_to_end(extract_mesh(cars[cars.codes.index["cars-0000030-0000030"]], 80))


def triangles_by_part(mesh: Mesh) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each part's name and triangles."""
    names, counts = zip(*mesh.part_counts, strict=True)
    return zip(names, np.split(mesh.faces, np.cumsum(counts)[:-1]), strict=True)


def test_a_car_has_a_wheel_at_each_corner_glass_above_them_and_a_body(car: tuple[Model, Mesh]):
    _, mesh = car
    low = mesh.vertices.min(0)
    size = mesh.vertices.max(0) - low
    positions = {name: (mesh.vertices[faces].mean(1) - low) / size for name, faces in triangles_by_part(mesh)}
    assert list(positions) == ["body", "wheels", "glass"]
    assert sum(map(len, positions.values())) == len(mesh.faces)
    wheels = positions["wheels"]
    corners = [wheels[((wheels[:, :2] > 0.5) == corner).all(1)] for corner in np.ndindex(2, 2)]
    for corner in corners:
        assert len(corner) > 100 and np.ptp(corner[:, 1:], 0).max() < 0.45 and corner[:, 2].min() < 0.02
    assert wheels[:, 2].max() < 0.5 and positions["glass"][:, 2].min() > 0.38


@pytest.mark.parametrize(("suffix", "texture"), [(".glb", 0), (".glb", 64), (".obj", 0)])
def test_a_file_has_a_named_object_for_each_part(suffix: str, texture: int, car: tuple[Model, Mesh], tmp_path: Path):
    cars, mesh = car
    path = tmp_path / f"car{suffix}"
    instance = cars[cars.codes.index["cars-0000030-0000030"]]
    list(export_mesh(instance, path, MeshSettings(80, texture=texture, triangles=4000)))
    read = trimesh.load_scene(path, process=False, split_object=True)
    names = {node: read.geometry[read.graph[node][1]] for node in read.graph.nodes_geometry}
    if suffix == ".obj":
        assert [line[2:] for line in path.read_text().splitlines() if line[:2] == "o "] == ["body", "wheels", "glass"]
    else:
        assert sorted(names) == ["body", "glass", "wheels"]
    assert 3500 < sum(map(len, (geometry.faces for geometry in names.values()))) <= 4000
    car_mesh = read.to_geometry()
    car_mesh.merge_vertices(merge_tex=True, merge_norm=True)
    full = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert len(full.faces) > 2 * 4000 and car_mesh.area == pytest.approx(full.area, rel=0.05)
    np.testing.assert_allclose(car_mesh.bounds, np.sort(full.bounds @ WORLD_FROM_GLTF, 0), atol=0.02)
    edges = np.unique(np.sort(car_mesh.edges, 1), axis=0, return_counts=True)[1]
    assert (edges == 2).mean() > 0.999  # parts meet without a gap


def test_chairs_have_their_own_parts_and_a_seat_ends_below_the_back():
    chairs = load_model("chairs")
    stool = chairs[chairs.codes.index["blendswap_cc_0_stool2"]]
    assert [name for name, _ in run_to_end(extract_mesh(stool, 64)).part_counts] == ["seat", "legs"]
    chair = chairs[chairs.codes.index["quaternius_oct2017_chaircushioned"]]
    mesh = run_to_end(extract_mesh(chair, 64))
    heights = {name: mesh.vertices[faces][..., 2] for name, faces in triangles_by_part(mesh)}
    assert {"seat", "back", "legs"} <= set(heights)
    top = np.median(heights["seat"])
    assert heights["legs"].max() < top + 0.1 and heights["back"].min() > top - 0.15
    assert heights["seat"].max() < np.median(heights["back"])


def test_every_triangle_is_of_one_part_with_a_head_and_without(tiny: Model):
    assert run_to_end(extract_mesh(tiny[0], 32)).part_counts[0][0] == "stool"
    plain = run_to_end(extract_mesh(tiny[0], 32))
    width = tiny.field.config.width
    for favoured, name in enumerate(("first", "second", "third")):
        head = PartHead(("first", "second", "third"), torch.zeros(3, width), 9.0 * torch.eye(3)[favoured])
        mesh = run_to_end(extract_mesh(replace(tiny, part_head=head)[0], 32))
        assert mesh.part_counts == ((name, len(plain.faces)),)
        assert np.array_equal(mesh.faces, plain.faces)
