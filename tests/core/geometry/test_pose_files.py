from pathlib import Path

import numpy as np
import pytest
import torch

from core.geometry.camera import Camera
from core.geometry.pose_files import read_pose

CAMERA = Camera(0.7, 0.4, 1.5, 131.25, 128, 128)
OPENCV = CAMERA.pose().numpy()
OPENGL = OPENCV @ np.diag([1.0, -1.0, -1.0, 1.0])


def write(path: Path, matrix: np.ndarray) -> Path:
    path.write_text("\n".join(" ".join(map(str, row)) for row in matrix), "utf-8-sig")
    return path


def test_poses_of_srn_and_of_blender_are_read(tmp_path: Path) -> None:
    for axes, matrix in (("opencv", OPENCV), ("opengl", OPENGL)):
        found = read_pose(write(tmp_path / "pose.txt", matrix), axes)
        torch.testing.assert_close(found, torch.from_numpy(OPENCV), atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    ("matrix", "axes", "said"),
    [
        (OPENGL, "opencv", "it is a pose in OpenGL axes"),
        (OPENCV, "opengl", "it is a pose in OpenCV axes"),
        (np.linalg.inv(OPENCV), "opencv", "it goes from world to camera;"),
        (np.linalg.inv(OPENGL), "opencv", "it goes from world to camera, in OpenGL axes"),
        (np.zeros((4, 4)), "opencv", "must not be at the origin"),
        (np.diag([1.0, 1, 1, 0]) + 1, "opencv", "does not look at the origin"),
    ],
)
def test_another_convention_is_recognised(tmp_path: Path, matrix: np.ndarray, axes: str, said: str) -> None:
    with pytest.raises(ValueError, match=rf"pose\.txt: .*{said}"):
        read_pose(write(tmp_path / "pose.txt", matrix), axes)
