"""A mesh as binary glTF 2.0, with a node for each part and optionally a camera.

The material is unlit because the colours contain the light.
"""

import json
import math
import struct
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8, UInt16
from PIL import Image

from core.geometry.camera import WORLD_FROM_GLTF, Camera

_UNLIT = "KHR_materials_unlit"
_COLOUR = "_COLOUR"  # vertex attribute of the linear colours until the file is complete
MeshParts = tuple[tuple[str, int], ...]  # name and number of triangles of each part, in the order of the triangles


def glb(
    vertices: Float[np.ndarray, "vertices 3"],
    normals: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    part_counts: MeshParts,
    *,
    colours: Float[np.ndarray, "vertices 3"] | None = None,
    uv: Float[np.ndarray, "vertices 2"] | None = None,
    image: UInt8[np.ndarray, "height width 3"] | None = None,
) -> bytes:
    """Return the bytes of a .glb file, with the colours of the vertices or an image.

    Args:
        vertices, normals: glTF axes.
        part_counts: of the triangles, in their order; vertices are not shared between parts.
        colours: sRGB, 0..1.
        uv: places of the vertices in the image, 0..1, from its left and bottom edge.
    """
    from trimesh import Scene, Trimesh  # imported late: the window only lists the formats
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    texture = None if image is None else Image.fromarray(image)
    material = PBRMaterial(baseColorTexture=texture, metallicFactor=0.0, roughnessFactor=1.0)
    scene = Scene()
    start = 0
    for name, count in part_counts:
        used, corners = np.unique(faces[start : start + count], return_inverse=True)
        mesh = Trimesh(
            vertices[used],
            corners.reshape(-1, 3),
            vertex_normals=normals[used],
            visual=TextureVisuals(None if uv is None else uv[used], material),
            vertex_attributes={} if colours is None else {_COLOUR: _linear(colours[used])},
            process=False,
            validate=False,
        )
        scene.add_geometry(mesh, node_name=name, geom_name=name)
        start += count
    return scene.export(file_type="glb", tree_postprocessor=_complete, include_normals=True)


def _linear(colours: Float[np.ndarray, "vertices 3"]) -> UInt16[np.ndarray, "vertices 4"]:
    """Return opaque linear colours, as glTF requires, in 16 bits so that dark colours keep their steps."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return (np.hstack((linear, np.ones((len(linear), 1)))) * 65535 + 0.5).astype(np.uint16)


def _complete(tree: dict[str, Any]) -> None:
    """Make the materials unlit and name the vertices' colours as glTF does, in the JSON of a file."""
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", ()), _UNLIT]
    for material in tree["materials"]:
        material["extensions"] = {_UNLIT: {}}
    for mesh in tree["meshes"]:
        attributes = mesh["primitives"][0]["attributes"]
        if _COLOUR in attributes:
            attributes["COLOR_0"] = attributes.pop(_COLOUR)
            tree["accessors"][attributes["COLOR_0"]]["normalized"] = True


def place_camera(file: bytes, camera: Camera, origin: Float[np.ndarray, "3"], scale: float) -> bytes:
    """Add a camera node to the scene of a .glb file.

    Args:
        origin: the file's origin in the world, scene units.
        scale: file units per scene unit.
    """
    (length,) = struct.unpack("<I", file[12:16])
    document = json.loads(file[20 : 20 + length])
    rotation, place = (tensor.numpy() for tensor in camera.world_to_camera(torch.device("cpu")))
    matrix = np.eye(4)
    # Rows of the rotation are the camera's axes right, up, backward: glTF's convention, too.
    matrix[:3, :3] = (rotation @ WORLD_FROM_GLTF).T
    matrix[:3, 3] = scale * (place - origin) @ WORLD_FROM_GLTF
    lens = {"yfov": 2 * math.atan(camera.height / (2 * camera.focal)), "aspectRatio": camera.width / camera.height}
    lens |= {"znear": 0.01 * scale * camera.distance, "zfar": 100 * scale * camera.distance}
    document["cameras"] = [{"type": "perspective", "perspective": lens}]
    document["nodes"].append({"name": "camera", "camera": 0, "matrix": matrix.T.ravel().tolist()})
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    return _file(document, file[20 + length :])


def _file(document: dict, rest: bytes) -> bytes:
    """Assemble a file from its JSON and the chunks that follow."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + rest
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
