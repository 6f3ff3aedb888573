"""A mesh as binary glTF 2.0: a node for each part, a material for each variant, and a camera.

Materials are unlit because the colours contain the light.
"""

import io
import json
import math
import struct
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt16
from PIL import Image

from core.export.triangle_mesh import Mesh
from core.geometry.camera import WORLD_FROM_GLTF, Camera

_UNLIT, _VARIANTS = "KHR_materials_unlit", "KHR_materials_variants"
_TYPES = {"<f4": 5126, "<u4": 5125, "<u2": 5123}  # glTF's numbers of component types
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_CORNERS, _INDICES = 34962, 34963  # what a view of the buffer holds
_CLAMPED = 33071  # of a texture's edges


def glb(mesh: Mesh, view: tuple[Camera, Float[np.ndarray, "3"], float] | None = None) -> bytes:
    """Return the bytes of a .glb file. Images of several variants share vertices and texture coordinates.

    Args:
        view: a camera for the file, the file's origin in the world (scene units), and its units per scene unit.
    """
    buffer = _Buffer()
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "CodeNeRF Viewer"}, "scene": 0}
    document |= _materials(mesh, buffer)
    mappings = [{"material": number, "variants": [number]} for number in range(len(mesh.images))]
    extensions = {"extensions": {_VARIANTS: {"mappings": mappings}}} if len(mappings) > 1 else {}
    document["meshes"] = [
        {"name": name, "primitives": [{**_primitive(part, buffer), **extensions}]} for name, part in mesh.parts()
    ]
    document["nodes"] = [{"name": name, "mesh": number} for number, (name, _) in enumerate(mesh.part_counts)]
    document["scenes"] = [{"nodes": [*range(len(mesh.part_counts))]}]
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    if view:
        lens, matrix = _camera_node(*view)
        document["cameras"] = [lens]
        document["nodes"].append({"name": "camera", "camera": 0, "matrix": matrix})
        document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(buffer.data), 0x004E4942) + buffer.data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _materials(mesh: Mesh, buffer: "_Buffer") -> dict[str, Any]:
    """Return the entries of a document for the mesh's materials and their images."""
    if not mesh.images:
        return {"extensionsUsed": [_UNLIT], "materials": [_material("colours")]}
    document: dict[str, Any] = {
        "extensionsUsed": [_UNLIT],
        "materials": [_material(name, texture) for texture, name in enumerate(mesh.images)],
        "textures": [{"source": source, "sampler": 0} for source in range(len(mesh.images))],
        "images": [buffer.image(image) for image in mesh.images.values()],
        "samplers": [{"wrapS": _CLAMPED, "wrapT": _CLAMPED}],
    }
    if len(mesh.images) > 1:
        document["extensionsUsed"].append(_VARIANTS)
        document["extensions"] = {_VARIANTS: {"variants": [{"name": name} for name in mesh.images]}}
    return document


def _material(name: str, texture: int | None = None) -> dict[str, Any]:
    surface = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    image = {} if texture is None else {"baseColorTexture": {"index": texture}}
    return {"name": name or "colours", "pbrMetallicRoughness": surface | image, "extensions": {_UNLIT: {}}}


def _primitive(part: Mesh, buffer: "_Buffer") -> dict[str, Any]:
    attributes = {"POSITION": buffer.accessor(part.vertices, "<f4"), "NORMAL": buffer.accessor(part.normals, "<f4")}
    if part.colours is not None:
        attributes["COLOR_0"] = buffer.accessor(_linear(part.colours), "<u2")
    if part.uv is not None:
        attributes["TEXCOORD_0"] = buffer.accessor(part.uv * (1, -1) + (0, 1), "<f4")
    indices = buffer.accessor(part.faces.reshape(-1, 1), "<u4", _INDICES)
    return {"attributes": attributes, "indices": indices, "material": 0}


class _Buffer:
    """The binary part of a file, with the JSON that describes it."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def accessor(self, values: np.ndarray, kind: str, target: int = _CORNERS) -> int:
        """Add rows of numbers and return the number of their accessor."""
        rows = values.astype(kind)
        count, width = rows.shape
        view = self._view(rows.tobytes(), {"target": target})
        described: dict[str, Any] = {"bufferView": view, "componentType": _TYPES[kind]}
        described |= {"count": count, "type": _SHAPES[width], "normalized": kind == "<u2"}
        if width == 3:  # required of positions
            described |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self.accessors.append(described)
        return len(self.accessors) - 1

    def image(self, pixels: np.ndarray) -> dict[str, Any]:
        """Add an image and return its entry."""
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG")
        return {"bufferView": self._view(file.getvalue(), {}), "mimeType": "image/png"}

    def _view(self, data: bytes, described: dict[str, int]) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **described})
        self.data += data + bytes(-len(data) % 4)
        return len(self.views) - 1


def _linear(colours: Float[np.ndarray, "vertices 3"]) -> UInt16[np.ndarray, "vertices 4"]:
    """Return opaque linear colours, as glTF requires, in 16 bits so that dark colours keep their steps."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return (np.hstack((linear, np.ones((len(linear), 1)))) * 65535 + 0.5).astype(np.uint16)


def _camera_node(camera: Camera, origin: Float[np.ndarray, "3"], scale: float) -> tuple[dict[str, Any], list[float]]:
    """Return a camera's entry, and the matrix of its node, for the ``view`` of :func:`glb`."""
    rotation, position = (tensor.numpy() for tensor in camera.world_to_camera(torch.device("cpu")))
    matrix = np.eye(4)
    # Rows of the rotation are the camera's axes right, up, backward: glTF's convention, too.
    matrix[:3, :3] = (rotation @ WORLD_FROM_GLTF).T
    matrix[:3, 3] = scale * (position - origin) @ WORLD_FROM_GLTF
    lens = {"yfov": 2 * math.atan(camera.height / (2 * camera.focal)), "aspectRatio": camera.width / camera.height}
    lens |= {"znear": 0.01 * scale * camera.distance, "zfar": 100 * scale * camera.distance}
    return {"type": "perspective", "perspective": lens}, matrix.T.ravel().tolist()
