"""GLB files arrive in the world's axes and scale, with their colours; the split keeps test objects out of training."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from core.lab.datasets.categories import SPLITS, Split, held_out_meshes
from core.lab.datasets.glb_objects import load_mesh, mesh_tasks, render_objects, select_meshes
from core.lab.datasets.rasteriser import Rasteriser
from core.lab.datasets.srn import read_dataset


def write_folder(folder: Path, names: list[str]) -> None:
    """Write a mesh folder with one box for each name."""
    for name in names:
        trimesh.Scene([trimesh.creation.box((1, 2, 3))]).export(folder / f"{name}.glb")
    lines = [{"id": name, "category": "chairs", "file": f"{name}.glb"} for name in names]
    (folder / "index.json").write_text(json.dumps(lines))


def test_axes_scale_and_scene_graph_are_the_worlds(tmp_path: Path) -> None:
    """glTF's (right, up, front) = (x, y, z) becomes the world's (-x, z, y): front at +y, up at +z."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((2, 4, 6)))
    nose = trimesh.creation.box((0.2, 0.2, 0.2))
    nose.visual.vertex_colors = (255, 0, 0, 255)
    scene.add_geometry(nose, transform=trimesh.transformations.translation_matrix((0.5, 1.0, 3.4)))
    scene.export(tmp_path / "box.glb")
    surfaces = load_mesh(tmp_path / "box.glb")
    everything = np.concatenate([surface.vertices for surface in surfaces])
    low = everything.min(0)
    high = everything.max(0)
    assert np.linalg.norm(high - low) == pytest.approx(1)
    assert low == pytest.approx(-high)
    assert (high - low) / (high - low)[0] == pytest.approx(np.array([2, 6.5, 4]) / 2)
    red = next(surface for surface in surfaces if surface.colours[0].tolist() == [1, 0, 0])
    x, y, z = red.vertices.mean(0)
    assert x < 0 < z
    assert y > 0.35
    box = next(surface for surface in surfaces if surface is not red)
    outward = (box.normals * (box.vertices - box.vertices.mean(0))).sum(-1)
    assert (outward > 0).all()


def test_a_turn_is_counter_clockwise_from_above(tmp_path: Path) -> None:
    scene = trimesh.Scene([trimesh.creation.box((2, 2, 6), trimesh.transformations.translation_matrix((0, 0, 2)))])
    scene.add_geometry(trimesh.creation.box((4, 2, 2)))
    scene.export(tmp_path / "t.glb")
    straight, turned = (np.concatenate([s.vertices for s in load_mesh(tmp_path / "t.glb", a)]) for a in (0, 90))
    assert turned[:, 0] == pytest.approx(-straight[:, 1], abs=1e-9)
    assert turned[:, 1] == pytest.approx(straight[:, 0], abs=1e-9)


def test_textures_and_colour_factors_are_read(tmp_path: Path, rasteriser: Rasteriser) -> None:
    image = Image.fromarray(np.tile(np.array([10, 200, 30], np.uint8), (4, 4, 1)))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=(255, 255, 255, 255))
    textured = trimesh.creation.box((1, 1, 1))
    textured.visual = trimesh.visual.TextureVisuals(np.zeros((8, 2)), material)
    plain = trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix((3, 0, 0)))
    factor = trimesh.visual.material.PBRMaterial(baseColorFactor=(200, 20, 20, 255))
    plain.visual = trimesh.visual.TextureVisuals(material=factor)
    trimesh.Scene([textured, plain]).export(tmp_path / "two.glb")
    surfaces = load_mesh(tmp_path / "two.glb")
    assert [surface.texture is None for surface in surfaces] == [False, True]
    assert surfaces[1].colours[0] == pytest.approx(np.array([200, 20, 20]) / 255, abs=0.01)
    rasteriser.upload(surfaces)


def test_files_that_hold_no_mesh_are_named(tmp_path: Path) -> None:
    (tmp_path / "bad.glb").write_bytes(b"glTF?")
    with pytest.raises(ValueError, match=r"bad\.glb"):
        load_mesh(tmp_path / "bad.glb")
    with pytest.raises(ValueError, match=r"index\.json"):
        select_meshes(tmp_path, "chairs", "train")
    (tmp_path / "index.json").write_text("[]")
    with pytest.raises(ValueError, match="no chairs in the train split"):
        select_meshes(tmp_path, "chairs", "train")


def test_rendering_yields_names_writes_a_dataset_and_resumes(tmp_path: Path, rasteriser: Rasteriser) -> None:
    test_mesh = min(held_out_meshes("chairs")["test"])
    write_folder(tmp_path, ["one", "two", test_mesh])
    out = tmp_path / "out"

    def rendered(out: Path, split: Split, views: int, size: int) -> Iterator[str]:
        return render_objects(mesh_tasks(tmp_path, "chairs", split), out, "chairs", split, views, size)

    assert next(rendered(out, "train", 4, 32)) == "one"
    assert [views.name for views in read_dataset(out).objects] == ["one"]
    first_time = (out / "one/rgb/000000.png").stat().st_mtime_ns
    assert list(rendered(out, "train", 4, 32)) == ["one", "two"]
    assert (out / "one/rgb/000000.png").stat().st_mtime_ns == first_time
    dataset = read_dataset(out)
    assert (dataset.category, dataset.image_size, len(dataset.objects[0].cameras)) == ("chairs", 32, 4)
    assert all(0.02 < views.masks.mean() < 0.5 for views in dataset.objects)
    assert list(rendered(tmp_path / "test", "test", 3, 32)) == [test_mesh]
    # Another size is another job: the old images are replaced.
    assert list(rendered(out, "train", 4, 16)) == ["one", "two"]
    assert read_dataset(out).image_size == 16


def test_the_shared_meshes_split_and_face_the_front(shared: Path) -> None:
    for category in ("chairs", "cars"):
        meshes = shared / "meshes"
        selected = {split: {entry.id for entry in select_meshes(meshes, category, split)} for split in SPLITS}
        held = held_out_meshes(category)
        assert (selected["validation"], selected["test"]) == (held["validation"], held["test"])
        assert len(held["validation"]) == len(held["test"]) == 10
        assert sum(map(len, selected.values())) == len(set().union(*selected.values()))
    # Most points above the seat are behind it.
    for entry in select_meshes(shared / "meshes", "chairs", "test"):
        if "stool" in entry.id:
            continue
        vertices = np.concatenate([s.vertices[s.faces].mean(1) for s in load_mesh(entry.file)])
        high = vertices[vertices[:, 2] > 0.7 * vertices[:, 2].max()]
        assert high[:, 1].mean() < 0, entry.id
