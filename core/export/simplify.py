"""Simplification of a closed mesh, which stays closed."""

from collections.abc import Generator

import numpy as np
from jaxtyping import Float, Int

_STEP = 0.75  # fraction of triangles kept in one call, which blocks the interpreter for half a second at most


def simplify(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], triangles: int
) -> Generator[float, None, tuple[Float[np.ndarray, "fewer 3"], Int[np.ndarray, "few 3"]]]:
    """Collapse edges by quadric error until ``triangles`` are left; yields the fraction done.

    Every edge keeps two triangles and every body stays one body, so a few more triangles may be left.
    """
    import igl  # imports slowly, and few meshes need it

    face_count = len(faces)
    while len(faces) > triangles:
        target = max(triangles, int(_STEP * len(faces)))
        fewer, corners, *_ = igl.qslim(vertices.astype(np.float64), faces.astype(np.int64), target)
        if len(corners) == len(faces):
            break
        vertices = fewer.astype(np.float32, "C")
        faces = corners.astype(np.int64, "C")
        yield (face_count - len(faces)) / max(1, face_count - triangles)
    return vertices, faces
