"""Opens a .glb of CodeNeRF Viewer in Blender, and sees the object through the camera of its photo.

    blender --python assets/blender_import.py -- chair.glb [photo.png]

Give the photo to see it behind the object. Where ``bpy`` is installed, a script can call :func:`open_glb`.
"""

import json
import sys
from pathlib import Path

import bpy

_HEIGHT = 1024
"""px, of renders"""


def open_glb(path, photo=None):
    """An otherwise empty scene with the object and, where the file has one, its camera; returns its parts and that."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path))
    scene, made = bpy.context.scene, list(bpy.data.objects)
    parts = [one for one in made if one.type == "MESH"]
    camera = next((one for one in made if one.type == "CAMERA"), None)
    world = bpy.data.worlds.new("white")
    world.color = (1.0, 1.0, 1.0)
    scene.world, scene.camera = world, camera
    # Light is in the colours already: they are to come out as they are in the file.
    scene.view_settings.view_transform = "Standard"
    if camera:
        scene.render.resolution_y, scene.render.resolution_x = _HEIGHT, round(_HEIGHT * _aspect(path))
        if photo:
            camera.data.show_background_images = True
            behind = camera.data.background_images.new()
            behind.image, behind.alpha = bpy.data.images.load(str(photo)), 0.5
    return parts, camera


def _aspect(path):
    """Width of the camera's image over its height."""
    data = Path(path).read_bytes()
    about = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return about["cameras"][0]["perspective"]["aspectRatio"]


if __name__ == "__main__" and "--" in sys.argv:
    open_glb(*map(Path, sys.argv[sys.argv.index("--") + 1 :]))
