"""SRN's cameras: the laws that they keep."""

import math

import numpy as np
import pytest

from core.lab.datasets.srn_cameras import SPIRAL_VIEWS, spiral_views, training_views


@pytest.mark.parametrize("count", [1, 7, 50, 200])
def test_three_in_four_training_views_lie_above_the_horizon(count: int) -> None:
    cameras = training_views(count, np.random.default_rng(3), 2.0)
    assert sum(camera.elevation > 0 for camera in cameras) == round(0.75 * count)
    assert {camera.distance for camera in cameras} == {2.0}
    assert {(camera.focal, camera.width, camera.height) for camera in cameras} == {(131.25, 128, 128)}


def test_training_views_repeat_and_cover_each_half_evenly() -> None:
    """Points spread evenly over a half sphere have heights spread evenly between 0 and 1."""
    cameras = training_views(4000, np.random.default_rng(0), 1.3)
    above = [math.sin(camera.elevation) for camera in cameras if camera.elevation > 0]
    assert np.histogram(above, 10, (0, 1))[0] == pytest.approx(np.full(10, 300), abs=60)
    around = np.histogram([camera.azimuth for camera in cameras], 8, (-math.pi, math.pi))[0]
    assert around == pytest.approx(np.full(8, 500), abs=90)
    assert training_views(9, np.random.default_rng(5), 2.0) == training_views(9, np.random.default_rng(5), 2.0)


def test_the_spiral_rises_steadily_at_any_count_and_size() -> None:
    cameras = spiral_views(SPIRAL_VIEWS, 1.3)
    elevations = np.array([camera.elevation for camera in cameras])
    assert elevations[0] == 0
    assert elevations[-1] == pytest.approx(math.pi / 2)
    assert np.diff(elevations) == pytest.approx(np.full(250, math.pi / 500))
    turns = np.unwrap([camera.azimuth for camera in cameras])
    assert np.diff(turns) == pytest.approx(np.full(250, -0.6))
    fine = spiral_views(251, 2.0)
    coarse = spiral_views(51, 2.0)
    for camera, expected in zip(coarse, fine[::5], strict=True):
        assert camera.azimuth == pytest.approx(expected.azimuth, abs=1e-9)
        assert camera.elevation == pytest.approx(expected.elevation)
    assert spiral_views(3, 2.0, 64)[0].focal == pytest.approx(131.25 / 2)
