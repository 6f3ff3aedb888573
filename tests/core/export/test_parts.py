from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from core.export.glb import split
from core.export.mesh import MeshSettings, export_mesh, extract_mesh
from core.export.mesh_formats import Mesh
from core.models.library import load_model
from core.models.model import Model
from core.models.part_head import PartHead
from core.streams import run_to_end


@pytest.fixture(scope="module")
def car() -> tuple[Model, Mesh]:
    cars = load_model("cars")
    return cars, run_to_end(extract_mesh(cars[cars.codes.index["cars-0000030-0000030"]], 80))


def test_a_car_has_a_wheel_at_each_corner_glass_above_them_and_a_body(car: tuple[Model, Mesh]):
    _, found = car
    low, high = found.vertices.min(0), found.vertices.max(0)
    places = {
        name: (found.vertices[faces].mean(1) - low) / (high - low) for name, faces in split(found.faces, found.parts)
    }
    assert list(places) == ["body", "wheels", "glass"]
    assert sum(map(len, places.values())) == len(found.faces)
    wheels, glass = places["wheels"], places["glass"]
    corners = [wheels[((wheels[:, :2] > 0.5) == corner).all(1)] for corner in np.ndindex(2, 2)]
    for corner in corners:
        assert len(corner) > 100 and np.ptp(corner[:, 1:], 0).max() < 0.45 and corner[:, 2].min() < 0.02
    assert wheels[:, 2].max() < 0.5 and glass[:, 2].min() > 0.38


@pytest.mark.parametrize(("suffix", "texture"), [(".glb", 0), (".glb", 64), (".obj", 0)])
def test_a_file_has_a_named_object_for_each_part(suffix: str, texture: int, car: tuple[Model, Mesh], tmp_path: Path):
    cars, found = car
    path, instance = tmp_path / f"car{suffix}", cars[cars.codes.index["cars-0000030-0000030"]]
    list(export_mesh(instance, path, MeshSettings(80, texture=texture, triangles=4000)))
    read = trimesh.load_scene(path, process=False, split_object=True)
    names = {node: read.geometry[read.graph[node][1]] for node in read.graph.nodes_geometry}
    if suffix == ".obj":
        assert [line[2:] for line in path.read_text().splitlines() if line[:2] == "o "] == ["body", "wheels", "glass"]
    else:
        assert sorted(names) == ["body", "glass", "wheels"]
    assert 3500 < sum(len(part.faces) for part in names.values()) <= 4000
    whole = read.to_geometry()
    whole.merge_vertices(merge_tex=True, merge_norm=True)
    area = trimesh.Trimesh(found.vertices, found.faces).area
    assert whole.area == pytest.approx(area, rel=0.05)
    edges = np.unique(np.sort(whole.edges, 1), axis=0, return_counts=True)[1]
    assert (edges == 2).mean() > 0.999  # parts meet without a gap


def test_chairs_have_the_parts_that_they_have_and_a_seat_ends_where_the_back_begins():
    chairs = load_model("chairs")
    stool = chairs[chairs.codes.index["blendswap_cc_0_stool2"]]
    assert [name for name, _ in run_to_end(extract_mesh(stool, 64)).parts] == ["seat", "legs"]
    chairs = load_model("chairs")
    chair = chairs[chairs.codes.index["quaternius_oct2017_chaircushioned"]]
    found = run_to_end(extract_mesh(chair, 64))
    heights = {name: found.vertices[faces][..., 2] for name, faces in split(found.faces, found.parts)}
    assert {"seat", "back", "legs"} <= set(heights)
    top = np.median(heights["seat"])
    assert heights["legs"].max() < top + 0.1 and heights["back"].min() > top - 0.15
    assert heights["seat"].max() < np.median(heights["back"])


def test_every_triangle_is_of_one_part_with_a_head_and_without(tiny: Model):
    assert run_to_end(extract_mesh(tiny[0], 32)).parts[0][0] == "stool"
    plain = run_to_end(extract_mesh(tiny[0], 32))
    width = tiny.field.config.width
    for favoured, name in enumerate(("first", "second", "third")):
        head = PartHead(("first", "second", "third"), torch.zeros(3, width), 9.0 * torch.eye(3)[favoured])
        found = run_to_end(extract_mesh(replace(tiny, part_head=head)[0], 32))
        assert found.parts == ((name, len(plain.faces)),)
        assert np.array_equal(found.faces, plain.faces)
