import math

import numpy as np
import pytest

from core.geometry.camera import Camera
from viewer.values.frusta import OverviewCamera, box, frustum, ring


@pytest.mark.parametrize("azimuth, elevation", [(0.0, 0.0), (1.2, 0.4), (-2.0, -1.0), (0.3, math.pi / 2)])
def test_a_frustum_stands_at_its_camera_and_looks_at_the_origin(azimuth: float, elevation: float) -> None:
    camera = Camera(azimuth, elevation, 1.7, 130.0, 128, 96)
    lines = frustum(camera)
    place = camera.pose()[:3, 3].numpy()
    np.testing.assert_allclose(lines[:4, 0], np.tile(place, (4, 1)), atol=1e-6)
    corners = lines[:4, 1]
    np.testing.assert_allclose(np.cross(corners.mean(0), place), 0, atol=1e-6)
    assert np.linalg.norm(corners.mean(0)) < 1.7
    sides = np.linalg.norm(lines[4:, 0] - lines[4:, 1], axis=-1)
    assert sides[0] / sides[1] == pytest.approx(128 / 96)


def test_an_overview_from_above_sees_the_horizontal_plane_as_it_is() -> None:
    above = OverviewCamera(-math.pi / 2, math.pi / 2)
    np.testing.assert_allclose(
        above.project(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 5.0]])), [[1, 0], [0, -1]], atol=1e-9
    )
    level = OverviewCamera(-math.pi / 2, 0.0).turned(0.0, -1.0)
    assert level.elevation == 0
    np.testing.assert_allclose(level.project(np.array([0.5, 3.0, 2.0])), [0.5, -2], atol=1e-9)


def test_box_and_ring() -> None:
    lines = box((0.1, 0.2, 0.3))
    lengths = sorted(np.linalg.norm(lines[:, 0] - lines[:, 1], axis=-1).round(6).tolist())
    assert lengths == [0.2] * 4 + [0.4] * 4 + [0.6] * 4
    points = ring(2.0)
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), 2)
    np.testing.assert_allclose(points[-1, 1], points[0, 0], atol=1e-9)
