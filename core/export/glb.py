"""A coloured mesh as binary glTF 2.0, with a node for each part and optionally a camera.

The material is unlit because the colours contain the light.
"""

import json
import math
import struct
from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Int

from core.geometry.camera import WORLD_FROM_GLTF, Camera

_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_VERTICES, _INDICES = 34962, 34963
MeshParts = tuple[tuple[str, int], ...]  # name and number of triangles of each part, in the order of the triangles


def glb(
    vertices: Float[np.ndarray, "vertices 3"],
    normals: Float[np.ndarray, "vertices 3"],
    colours: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    part_counts: MeshParts,
) -> bytes:
    """Return the bytes of a .glb file.

    Args:
        vertices, normals: glTF axes.
        colours: sRGB, 0..1; written linear as glTF requires, in 16 bits so that dark colours keep their steps.
        part_counts: of the triangles, in their order; vertices are not shared between parts.
    """
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    paint = (np.hstack((linear, np.ones((len(linear), 1)))) * 65535 + 0.5).astype("<u2")
    document = _empty_document()
    body = b""
    for name, triangles in split(faces, part_counts):
        used, corners = np.unique(triangles, return_inverse=True)
        arrays = (vertices[used].astype("<f4"), normals[used].astype("<f4"), paint[used], corners.astype("<u4"))
        _add_mesh(document, name, arrays, len(body))
        body += b"".join(array.tobytes() for array in arrays)  # every length is a multiple of 4 bytes
    document["buffers"] = [{"byteLength": len(body)}]
    return _file(document, struct.pack("<II", len(body), 0x004E4942) + body)


def split(
    faces: Int[np.ndarray, "faces 3"], part_counts: MeshParts
) -> Iterator[tuple[str, Int[np.ndarray, "triangles 3"]]]:
    """Yield each part's name and triangles."""
    start = 0
    for name, count in part_counts:
        yield name, faces[start : start + count]
        start += count


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


def _empty_document() -> dict:
    """Return the JSON part without any mesh."""
    return {
        "asset": {"version": "2.0", "generator": "CodeNeRF Viewer"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": []}],
        "nodes": [],
        "meshes": [],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [],
        "bufferViews": [],
    }


def _add_mesh(document: dict, name: str, arrays: tuple[np.ndarray, ...], start: int) -> None:
    """Describe a node and its mesh (positions, normals, colours, indices) whose data begin at byte ``start``."""
    vertices = arrays[0]
    corners = arrays[3]
    first = len(document["accessors"])
    count = len(vertices)
    bounds = {"min": vertices.min(0).tolist(), "max": vertices.max(0).tolist()}
    document["accessors"] += [
        {"bufferView": first, "componentType": _FLOAT, "count": count, "type": "VEC3", **bounds},
        {"bufferView": first + 1, "componentType": _FLOAT, "count": count, "type": "VEC3"},
        {"bufferView": first + 2, "componentType": _USHORT, "normalized": True, "count": count, "type": "VEC4"},
        {"bufferView": first + 3, "componentType": _UINT, "count": corners.size, "type": "SCALAR"},
    ]
    for array, kind in zip(arrays, (_VERTICES, _VERTICES, _VERTICES, _INDICES), strict=True):
        document["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes, "target": kind})
        start += array.nbytes
    attributes = {"POSITION": first, "NORMAL": first + 1, "COLOR_0": first + 2}
    primitive = {"attributes": attributes, "indices": first + 3, "material": 0}
    index = len(document["meshes"])
    document["meshes"].append({"name": name, "primitives": [primitive]})
    document["nodes"].append({"name": name, "mesh": index})
    document["scenes"][0]["nodes"].append(index)
