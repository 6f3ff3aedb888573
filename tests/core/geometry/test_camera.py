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
    a, e = azimuth, elevation
    found = camera_rotation(torch.tensor(a, dtype=torch.float64), torch.tensor(e, dtype=torch.float64))
    paper = [
        [-math.sin(a), math.cos(a), 0],
        [-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e)],
        [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)],
    ]
    torch.testing.assert_close(found, torch.tensor(paper, dtype=torch.float64))
    torch.testing.assert_close(found @ found.T, torch.eye(3, dtype=torch.float64))
    assert torch.linalg.det(found) == pytest.approx(1.0)


@given(azimuths, elevations, st.floats(0.5, 5.0))
def test_pose_goes_there_and_back(azimuth: float, elevation: float, distance: float):
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
    ("wrong", "said"),
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
def test_numbers_that_no_camera_has_are_refused_by_name(wrong: dict, said: str):
    with pytest.raises(ValueError, match=f"camera .*{said}"):
        replace(Camera(0.3, 0.4, 1.3, 131.25, 128, 96), **wrong)


def test_genuine_srn_poses_are_orbit_cameras(shared):
    for path in sorted(shared.glob("upstream/srn_real/*/pose/*.txt")):
        pose = torch.tensor([float(word) for word in path.read_text().split()], dtype=torch.float64).reshape(4, 4)
        camera = Camera.from_pose(pose, 131.25, 128, 128)
        torch.testing.assert_close(camera.pose(), pose, atol=2e-4, rtol=0)
