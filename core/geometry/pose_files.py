"""Pose files: the 16 numbers of a camera's matrix, as ShapeNet-SRN has them, or in other programs' axes."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.camera import Camera
from core.runtime.reading import optional, read_numbers, reading

POSE_AXES = {
    "opencv": "camera to world, x right, y down, looking along +z: ShapeNet-SRN",
    "opengl": "camera to world, x right, y up, looking along -z: Blender, NeRF's transforms.json",
}
"""Conventions of the matrix that are read."""
_FLIPPED = np.diag([1.0, -1.0, -1.0, 1.0])
_LIKELY = {
    "opengl": "it is a pose in OpenGL axes (--pose-axes opengl reads it)",
    "opencv": "it is a pose in OpenCV axes (--pose-axes opencv reads it)",
    "opencv inverse": "it goes from world to camera; its inverse is wanted",
    "opengl inverse": "it goes from world to camera, in OpenGL axes; its inverse is wanted",
}


def read_pose(path: Path, axes: str = "opencv") -> Float[Tensor, "4 4"]:
    """The camera-to-world matrix of a file in OpenCV axes, float64.

    Args:
        axes: of the file, one of :data:`POSE_AXES`.

    Raises ``ValueError`` naming the file where it is no pose of an upright camera that looks at the origin, and its
    convention where that of another program would make it one.
    """
    with reading(path, "a pose"):
        matrix = torch.tensor(read_numbers(path, 16), dtype=torch.float64).reshape(4, 4)
        found = as_opencv(matrix, axes)
        try:
            Camera.from_pose(found, 1.0, 1, 1)
        except ValueError as error:
            others = (words for other, words in _LIKELY.items() if other != axes and _is_pose(matrix, other))
            if likely := next(others, None):
                raise ValueError(likely) from error
            raise
        return found


def as_opencv(matrix: Float[Tensor, "4 4"], axes: str) -> Float[Tensor, "4 4"]:
    """A camera's matrix with OpenCV axes, from one of :data:`POSE_AXES`, or from its ``inverse``."""
    convention, _, inverse = axes.partition(" ")
    if inverse:
        matrix = torch.linalg.inv(matrix)
    return matrix if convention == "opencv" else matrix @ torch.from_numpy(_FLIPPED)


def _is_pose(matrix: Float[Tensor, "4 4"], axes: str) -> bool:
    return optional(lambda: Camera.from_pose(as_opencv(matrix, axes), 1.0, 1, 1)) is not None
