"""Pose files: the 16 numbers of a camera's matrix, with ShapeNet-SRN's axes or OpenGL's."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from core.geometry.camera import OPENCV_FROM_OPENGL, Camera
from core.runtime.reading import optional, read_numbers, reading

_LIKELY = {  # error messages for poses with other axes
    "opengl": "it is a pose in OpenGL axes (--pose-axes opengl reads it)",
    "opencv": "it is a pose in OpenCV axes (--pose-axes opencv reads it)",
    "opencv inverse": "it goes from world to camera; its inverse is wanted",
    "opengl inverse": "it goes from world to camera, in OpenGL axes; its inverse is wanted",
}


def read_pose(path: Path, axes: str = "opencv") -> Float[Tensor, "4 4"]:
    """Read a camera-to-world matrix with OpenCV axes, float64.

    Args:
        axes: camera axes of the file: "opencv" (x right, y down, looking along +z: ShapeNet-SRN) or "opengl" (x right,
            y up, looking along -z: Blender, NeRF's transforms.json).

    Raises ``ValueError`` naming the file unless its camera is upright and looks at the origin. The message suggests
    other axes, or the inverse, if these make the pose valid.
    """
    with reading(path, "a pose"):
        matrix = torch.tensor(read_numbers(path, 16), dtype=torch.float64).reshape(4, 4)
        found = _as_opencv(matrix, axes)
        try:
            Camera.from_pose(found, 1.0, 1, 1)
        except ValueError as error:
            others = (words for other, words in _LIKELY.items() if other != axes and _is_pose(matrix, other))
            if likely := next(others, None):
                raise ValueError(likely) from error
            raise
        return found


def _as_opencv(matrix: Float[Tensor, "4 4"], axes: str) -> Float[Tensor, "4 4"]:
    """Convert a camera-to-world matrix to OpenCV axes; ``axes`` may end with "inverse" for world-to-camera."""
    convention, _, inverse = axes.partition(" ")
    if inverse:
        matrix = torch.linalg.inv(matrix)
    return matrix if convention == "opencv" else matrix @ torch.from_numpy(OPENCV_FROM_OPENGL)


def _is_pose(matrix: Float[Tensor, "4 4"], axes: str) -> bool:
    return optional(lambda: Camera.from_pose(_as_opencv(matrix, axes), 1.0, 1, 1)) is not None
