import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.camera import Camera
from core.model import Model
from viewer import orbit

CAMERA = Camera(0.4, 0.2, 2.0, 131.25, 128, 128)


def test_a_drag_across_the_view_is_half_a_turn_with_the_hand() -> None:
    turned = orbit.dragged(CAMERA, 1.0, 0.0)
    # The object follows the hand to the right when the camera goes left, clockwise seen from above.
    assert turned.azimuth == pytest.approx(0.4 - math.pi)
    assert turned.elevation == CAMERA.elevation
    assert orbit.dragged(CAMERA, 0.0, 0.1).elevation > CAMERA.elevation


def test_small_drags_add_up_to_a_large_one() -> None:
    camera = CAMERA
    for _ in range(10):
        camera = orbit.dragged(camera, 0.01, -0.02)
    assert camera.azimuth == pytest.approx(orbit.dragged(CAMERA, 0.1, 0).azimuth)
    assert camera.elevation == pytest.approx(orbit.dragged(CAMERA, 0, -0.2).elevation)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_no_drag_leaves_the_orbit_or_passes_a_pole(across: float, down: float) -> None:
    camera = orbit.dragged(CAMERA, across, down)
    assert abs(camera.azimuth) <= math.pi + 1e-9
    assert abs(camera.elevation) < math.pi / 2


@given(st.floats(-1e3, 1e3))
def test_zoom_stays_in_reach(model: Model, steps: float) -> None:
    near, far = orbit.zoomed(CAMERA, 1e3, model).distance, orbit.zoomed(CAMERA, -1e3, model).distance
    assert 0 < near <= orbit.zoomed(CAMERA, steps, model).distance <= far
    assert near < model.distance < far


def test_zooming_in_and_out_again_comes_back(model: Model) -> None:
    there = orbit.zoomed(CAMERA, 2.0, model)
    assert there.distance < CAMERA.distance
    assert orbit.zoomed(there, -2.0, model).distance == pytest.approx(CAMERA.distance)


@pytest.mark.parametrize("size", [(800, 600), (600, 800), (700, 700), (1, 1), (3000, 20)])
def test_the_shorter_side_of_any_panel_shows_the_same(size: tuple[int, int]) -> None:
    camera = orbit.filling(CAMERA, *size, 256)
    assert min(camera.width, camera.height) == 256
    assert camera.width / camera.height == pytest.approx(size[0] / size[1], rel=0.02)
    assert camera.focal / 256 == pytest.approx(CAMERA.focal / CAMERA.height)
    assert (camera.azimuth, camera.elevation, camera.distance) == (0.4, 0.2, 2.0)


def test_home_sees_the_whole_object_from_its_front(model: Model) -> None:
    camera = orbit.home(model)
    assert camera.distance <= model.distance
    assert abs(camera.azimuth - math.pi / 2) < math.radians(45)
    assert camera.elevation > 0
