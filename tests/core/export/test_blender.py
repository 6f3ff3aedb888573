"""The script that opens a mesh in Blender, run by Blender: ``BPY_PYTHON`` names a Python that has ``bpy``."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from core.export.mesh import MeshSettings, export_mesh
from core.geometry.camera import WORLD_FROM_GLTF
from tests.core.tiny import tiny_model

_SCRIPT = Path(__file__).parents[3] / "assets/blender_import.py"
_PROJECT = """
import json, sys
from pathlib import Path
sys.path.insert(0, str(Path(sys.argv[1]).parent))
import bpy
from blender_import import open_glb
from bpy_extras.object_utils import world_to_camera_view
(item,), camera = open_glb(Path(sys.argv[2]))
bpy.context.view_layer.update()
scene = bpy.context.scene
places = [item.matrix_world @ vertex.co for vertex in item.data.vertices]
seen = [world_to_camera_view(scene, camera, place)[:2] for place in places]
size = scene.render.resolution_x, scene.render.resolution_y
Path(sys.argv[3]).write_text(json.dumps({"size": size, "seen": seen, "colours": len(item.data.color_attributes)}))
"""


@pytest.mark.slow
def test_blender_sees_the_object_as_the_camera_does(tmp_path: Path) -> None:
    python = os.environ.get("BPY_PYTHON")
    if not python:
        pytest.skip("BPY_PYTHON names no Python that has bpy")
    model = tiny_model()
    camera = model.camera(0.7, 0.4).resized(96, 64)
    list(export_mesh(model[0], tmp_path / "stool.glb", MeshSettings(32), camera))
    arguments = (str(_SCRIPT), str(tmp_path / "stool.glb"), str(tmp_path / "seen.json"))
    subprocess.run((python, "-c", _PROJECT, *arguments), check=True, timeout=600)
    imported = json.loads((tmp_path / "seen.json").read_text())
    assert imported["size"][0] / imported["size"][1] == pytest.approx(96 / 64, rel=0.01)
    assert imported["colours"] == 1
    stool = trimesh.load_scene(tmp_path / "stool.glb", process=False).to_geometry()
    world = torch.from_numpy(stool.vertices @ WORLD_FROM_GLTF.T).float()
    expected = camera.project(world).numpy() / (96, 64) * (1, -1) + (0, 1)  # from the lower left corner
    low, high = (np.stack((pixels.min(0), pixels.max(0))) for pixels in (np.array(imported["seen"]), expected))
    np.testing.assert_allclose(low, high, atol=0.003)
