import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.export.mesh import MeshSettings, export_mesh
from core.models.model import Model

RED = PartPaint("", (0.8, 0.1, 0.1), (0.5, 0.5, 0.5))


def gltf_of(data: bytes) -> dict[str, Any]:
    """Return the JSON of a .glb file's bytes."""
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_variants_share_one_mesh_and_each_has_its_image(tiny: Model, tmp_path: Path) -> None:
    path = tmp_path / "stool.glb"
    variants = {"plain": tiny[0], "red": tiny[0].with_edits(PartPaint, RED)}
    list(export_mesh(tiny[0], path, MeshSettings(32, texture=64), variants=variants))
    document = gltf_of(path.read_bytes())
    extension = "KHR_materials_variants"
    assert extension in document["extensionsUsed"]
    assert [entry["name"] for entry in document["extensions"][extension]["variants"]] == ["plain", "red"]
    assert [material["name"] for material in document["materials"]] == ["plain", "red"]
    ((primitive,),) = (mesh["primitives"] for mesh in document["meshes"])
    mappings = primitive["extensions"][extension]["mappings"]
    assert mappings == [{"material": number, "variants": [number]} for number in (0, 1)]
    assert primitive["material"] == 0 and len(document["images"]) == 2
    for number, (name, variant) in enumerate(variants.items()):
        alone = tmp_path / f"{name}.glb"
        list(export_mesh(variant, alone, MeshSettings(32, texture=64)))
        assert image_of(path, number) == image_of(alone, 0)
    read = trimesh.load_scene(path, process=False).to_geometry()
    np.testing.assert_allclose(read.vertices, trimesh.load_scene(alone, process=False).to_geometry().vertices)


def image_of(path: Path, number: int) -> bytes:
    """Return an image of a .glb file."""
    data = path.read_bytes()
    document = gltf_of(data)
    view = document["bufferViews"][document["images"][number]["bufferView"]]
    begin = 20 + int.from_bytes(data[12:16], "little") + 8 + view["byteOffset"]
    return data[begin : begin + view["byteLength"]]


def test_variants_of_other_shapes_and_formats_are_refused(tiny: Model, tmp_path: Path) -> None:
    red = tiny[0].with_edits(PartPaint, RED)
    for variant in (tiny[1], red.with_edits(Stretch, Stretch((1.0, 1.0, 1.2)))):
        with pytest.raises(ValueError, match="red has another shape"):
            list(
                export_mesh(tiny[0], tmp_path / "a.glb", MeshSettings(16), variants={"plain": tiny[0], "red": variant})
            )
    with pytest.raises(ValueError, match="holds variants"):
        list(export_mesh(tiny[0], tmp_path / "a.ply", MeshSettings(16), variants={"plain": tiny[0], "red": red}))
    assert list(tmp_path.iterdir()) == []
