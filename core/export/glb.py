"""Writes one coloured mesh as binary glTF 2.0. Its light is in its colours, so its material is unlit."""

import json
import struct

import numpy as np
from jaxtyping import Float, Int

_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_VERTICES, _INDICES = 34962, 34963


def glb(
    vertices: Float[np.ndarray, "vertices 3"],
    normals: Float[np.ndarray, "vertices 3"],
    colours: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> bytes:
    """The bytes of a .glb file.

    Args:
        vertices, normals: glTF axes.
        colours: sRGB, 0..1; glTF wants them linear, in 16 bits so that dark ones keep their steps.
    """
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    paint = np.hstack((linear, np.ones((len(linear), 1))))
    blobs = (
        vertices.astype("<f4").tobytes(),
        normals.astype("<f4").tobytes(),
        (paint * 65535 + 0.5).astype("<u2").tobytes(),
        faces.astype("<u4").tobytes(),
    )
    about = _about([len(blob) for blob in blobs], vertices.astype("<f4"), faces.size)
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(blobs)  # each is a multiple of 4 bytes long
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(body), 0x004E4942) + body
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _about(lengths: list[int], vertices: np.ndarray, indices: int) -> dict:
    """The JSON part: one mesh over four views of the buffer."""
    starts = [sum(lengths[:index]) for index in range(len(lengths))]
    kinds = (_VERTICES, _VERTICES, _VERTICES, _INDICES)
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": length, "target": kind}
        for start, length, kind in zip(starts, lengths, kinds, strict=True)
    ]
    count = len(vertices)
    bounds = {"min": vertices.min(0).tolist(), "max": vertices.max(0).tolist()}
    accessors = [
        {"bufferView": 0, "componentType": _FLOAT, "count": count, "type": "VEC3", **bounds},
        {"bufferView": 1, "componentType": _FLOAT, "count": count, "type": "VEC3"},
        {"bufferView": 2, "componentType": _USHORT, "normalized": True, "count": count, "type": "VEC4"},
        {"bufferView": 3, "componentType": _UINT, "count": indices, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0}
    return {
        "asset": {"version": "2.0", "generator": "CodeNeRF Viewer"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "extensions": {"KHR_materials_unlit": {}}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(lengths)}],
    }
