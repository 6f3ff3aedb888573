"""Open a .glb of CodeNeRF Viewer in Blender and show the object through the camera of its photo.

    blender --python assets/blender_import.py -- chair.glb [photo.png]

Give the photo to see it behind the object. Where ``bpy`` is installed, a script can call :func:`open_glb`.
"""

import json
import sys
from pathlib import Path

import bpy

_HEIGHT = 1024  # px, of renders


def open_glb(path, photo=None):
    """Make a scene of the file's object and camera alone; return its meshes and the camera, None without one."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path))
    scene = bpy.context.scene
    imported = list(bpy.data.objects)
    meshes = [item for item in imported if item.type == "MESH"]
    camera = next((item for item in imported if item.type == "CAMERA"), None)
    world = bpy.data.worlds.new("white")
    world.color = (1.0, 1.0, 1.0)
    scene.world = world
    scene.camera = camera
    # The colours contain the light: they are shown unchanged.
    scene.view_settings.view_transform = "Standard"
    if camera:
        scene.render.resolution_y = _HEIGHT
        scene.render.resolution_x = round(_HEIGHT * _aspect_ratio(path))
        if photo:
            camera.data.show_background_images = True
            background = camera.data.background_images.new()
            background.image = bpy.data.images.load(str(photo))
            background.alpha = 0.5
    return meshes, camera


def _aspect_ratio(path):
    """Return the width of the camera's image over its height."""
    data = Path(path).read_bytes()
    gltf = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return gltf["cameras"][0]["perspective"]["aspectRatio"]


if __name__ == "__main__" and "--" in sys.argv:
    open_glb(*map(Path, sys.argv[sys.argv.index("--") + 1 :]))
