import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.camera import Camera, camera_rotation

azimuths = st.floats(-math.pi, math.pi)
elevations = st.floats(-math.pi / 2, math.pi / 2)


@given(azimuths, elevations)
def test_rotation_is_the_papers_and_a_rotation(azimuth: float, elevation: float):
    rotation = camera_rotation(*torch.tensor([azimuth, elevation], dtype=torch.float64))
    sin_a, cos_a, sin_e, cos_e = (f(angle) for angle in (azimuth, elevation) for f in (math.sin, math.cos))
    paper = [
        [-sin_a, cos_a, 0],
        [-sin_e * cos_a, -sin_e * sin_a, cos_e],
        [cos_e * cos_a, cos_e * sin_a, sin_e],
    ]
    torch.testing.assert_close(rotation, torch.tensor(paper, dtype=torch.float64))
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3, dtype=torch.float64))
    assert torch.linalg.det(rotation) == pytest.approx(1.0)


@given(azimuths, elevations, st.floats(0.5, 5.0))
def test_camera_and_pose_round_trip(azimuth: float, elevation: float, distance: float):
    camera = Camera(azimuth, elevation, distance, 131.25, 128, 128)
    again = Camera.from_pose(camera.pose(), 131.25, 128, 128)
    torch.testing.assert_close(again.pose(), camera.pose(), atol=1e-7, rtol=0)


def test_an_orbit_camera_looks_at_the_origin_at_any_size():
    camera = Camera(math.pi / 2, 0.0, 1.3, 131.25, 128, 128)
    torch.testing.assert_close(camera.pose()[:3, 3], torch.tensor([0.0, 1.3, 0.0], dtype=torch.float64))
    camera = Camera(0.0, 0.0, 2.0, 131.25, 128, 128).resized(64, 64)
    assert (camera.focal, camera.width, camera.height) == (65.625, 64, 64)
    pose = Camera(0.3, 0.2, 1.3, 131.25, 128, 128).pose()
    pose[0, 3] += 0.2
    with pytest.raises(ValueError, match="origin"):
        Camera.from_pose(pose, 131.25, 128, 128)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"azimuth": math.nan}, "azimuth"),
        ({"elevation": 2.0}, "elevation"),
        ({"distance": 0.0}, "distance"),
        ({"focal": -1.0}, "focal"),
        ({"focal": math.inf}, "focal"),
        ({"width": 0}, "size"),
        ({"width": 30_000, "height": 30_000}, "size"),
    ],
)
def test_impossible_values_are_refused_by_name(wrong: dict, message: str):
    with pytest.raises(ValueError, match=f"camera .*{message}"):
        replace(Camera(0.3, 0.4, 1.3, 131.25, 128, 96), **wrong)


def test_genuine_srn_poses_are_orbit_cameras(shared):
    for path in sorted(shared.glob("upstream/srn_real/*/pose/*.txt")):
        pose = torch.tensor([float(word) for word in path.read_text().split()], dtype=torch.float64).reshape(4, 4)
        camera = Camera.from_pose(pose, 131.25, 128, 128)
        torch.testing.assert_close(camera.pose(), pose, atol=2e-4, rtol=0)
