"""A closed triangle mesh in colours, as all formats of files take it, and normals of triangles."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from core.geometry.camera import WORLD_FROM_GLTF

MeshParts = tuple[tuple[str, int], ...]  # name and number of triangles of each part, in the order of the triangles


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface whose triangles are counter-clockwise seen from outside.

    It has colours at its vertices, or images; then vertices are duplicated along the seams of the images.
    """

    vertices: Float[np.ndarray, "vertices 3"]  # world, scene units or m
    normals: Float[np.ndarray, "vertices 3"]  # unit length, outward
    faces: Int[np.ndarray, "faces 3"]
    part_counts: MeshParts
    colours: Float[np.ndarray, "vertices 3"] | None = None  # sRGB, 0..1
    uv: Float[np.ndarray, "vertices 2"] | None = None  # 0..1, from the images' left and bottom edge
    images: Mapping[str, UInt8[np.ndarray, "height width 3"]] = field(default_factory=dict)
    """by the name of a variant; the first is shown unless another is asked for"""

    def in_gltf_axes(self) -> "Mesh":
        """Return the mesh with y up and its front at +z, as glTF, USD and readers of obj files expect."""
        return replace(self, vertices=self.vertices @ WORLD_FROM_GLTF, normals=self.normals @ WORLD_FROM_GLTF)

    def parts(self) -> Iterator[tuple[str, "Mesh"]]:
        """Yield the name of each part and its triangles, with the vertices that they use."""
        start = 0
        for name, count in self.part_counts:
            used, corners = np.unique(self.faces[start : start + count], return_inverse=True)
            start += count
            colours = None if self.colours is None else self.colours[used]
            uv = None if self.uv is None else self.uv[used]
            faces = corners.reshape(-1, 3)
            yield name, Mesh(self.vertices[used], self.normals[used], faces, ((name, count),), colours, uv, self.images)


def face_normals(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3"]:
    """Return the outward normal of every triangle, with twice its area as length."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.cross(b - a, c - a)


def vertex_normals(
    count: int, faces: Int[np.ndarray, "faces 3"], of_faces: Float[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Return unit normals of ``count`` vertices, the area-weighted mean of their triangles; up for unused vertices."""
    sums = [sum(np.bincount(faces[:, i], of_faces[:, axis], count) for i in range(3)) for axis in range(3)]
    normals = np.stack(sums, -1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), (0.0, 0.0, 1.0)).astype(np.float32)
