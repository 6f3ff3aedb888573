"""Normals of meshes."""

import numpy as np
from jaxtyping import Float, Int


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
