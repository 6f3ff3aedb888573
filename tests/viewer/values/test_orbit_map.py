import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.camera import Camera
from viewer.values.orbit import VIEWS
from viewer.values.orbit_map import HORIZON, moved_to, place


def camera(azimuth: float, elevation: float) -> Camera:
    return Camera(azimuth, elevation, 1.3, 131.25, 128, 128)


def test_the_front_is_at_the_bottom_and_the_top_in_the_middle() -> None:
    assert place(camera(*VIEWS["front"])) == pytest.approx((0.0, HORIZON))
    assert place(camera(*VIEWS["top"])) == pytest.approx((0.0, 0.0), abs=0.01)
    assert math.hypot(*place(camera(1.0, -math.pi / 2))) == pytest.approx(1.0)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_places_and_cameras_go_there_and_back(azimuth: float, elevation: float) -> None:
    found = moved_to(camera(0.3, 0.1), *place(camera(azimuth, elevation)))
    assert (found.azimuth, found.elevation) == pytest.approx((azimuth, elevation), abs=1e-6)
    assert found.distance == 1.3


def test_beyond_the_disc_is_its_border() -> None:
    below = moved_to(camera(0.0, 0.0), 0.0, 7.0)
    assert math.hypot(*place(below)) == pytest.approx(1.0, abs=0.01)
    assert math.isfinite(moved_to(camera(0.0, 0.0), 0.0, 0.0).azimuth)
