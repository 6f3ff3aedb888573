import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.detail.progressive import Frame
from core.geometry.camera import Camera
from core.models.model import Model
from viewer.values import orbit

CAMERA = Camera(0.4, 0.2, 2.0, 131.25, 128, 128)


def test_drags_turn_half_a_turn_across_and_add_up() -> None:
    turned = orbit.dragged(CAMERA, 1.0, 0.0)
    # The object follows the hand to the right when the camera goes left, clockwise seen from above.
    assert turned.azimuth == pytest.approx(0.4 - math.pi)
    assert turned.elevation == CAMERA.elevation
    assert orbit.dragged(CAMERA, 0.0, 0.1).elevation > CAMERA.elevation
    camera = CAMERA
    for _ in range(10):
        camera = orbit.dragged(camera, 0.01, -0.02)
    assert camera.azimuth == pytest.approx(orbit.dragged(CAMERA, 0.1, 0).azimuth)
    assert camera.elevation == pytest.approx(orbit.dragged(CAMERA, 0, -0.2).elevation)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_no_drag_leaves_the_orbit_or_passes_a_pole(right: float, down: float) -> None:
    camera = orbit.dragged(CAMERA, right, down)
    assert abs(camera.azimuth) <= math.pi + 1e-9
    assert abs(camera.elevation) < math.pi / 2


@given(st.floats(-1e3, 1e3))
def test_zoom_stays_in_reach(model: Model, steps: float) -> None:
    near = orbit.zoomed(CAMERA, 1e3, model).distance
    far = orbit.zoomed(CAMERA, -1e3, model).distance
    assert 0 < near <= orbit.zoomed(CAMERA, steps, model).distance <= far
    assert near < model.distance < far


def test_zooms_come_back_and_home_sees_the_whole_object(model: Model) -> None:
    nearer = orbit.zoomed(CAMERA, 2.0, model)
    assert nearer.distance < CAMERA.distance
    assert orbit.zoomed(nearer, -2.0, model).distance == pytest.approx(CAMERA.distance)
    camera = orbit.home(model)
    assert camera.distance <= model.distance
    assert abs(camera.azimuth - math.pi / 2) < math.radians(45)
    assert camera.elevation > 0
    assert orbit.panned((0.5, 0.0), 0.25, -3.0) == (0.75, -1.0)


@pytest.mark.parametrize("size", [(800, 600), (600, 800), (700, 700), (1, 1), (3000, 20)])
def test_the_shorter_side_of_any_panel_shows_the_same(size: tuple[int, int]) -> None:
    crop = orbit.fit_to_panel(CAMERA, *size, 256)
    camera = crop.camera
    assert (crop.width, crop.height, crop.left, crop.top) == (camera.width, camera.height, 0, 0)
    assert min(camera.width, camera.height) == 256
    assert camera.width / camera.height == pytest.approx(size[0] / size[1], rel=0.02)
    assert camera.focal / 256 == pytest.approx(CAMERA.focal / CAMERA.height)
    assert (camera.azimuth, camera.elevation, camera.distance) == (0.4, 0.2, 2.0)


@pytest.mark.parametrize("pan", [(0.0, 0.0), (0.25, -0.5), (-1.0, 1.0)])
@pytest.mark.parametrize("divisor", [1, 4, 16])
def test_a_panned_view_shows_the_object_aside(pan: tuple[float, float], divisor: int) -> None:
    crop = orbit.fit_to_panel(CAMERA, 200, 100, 128, pan)
    camera = crop.camera
    assert camera.focal == pytest.approx(CAMERA.focal * 128 / CAMERA.height)
    height = max(1, camera.height // divisor)
    width = max(1, camera.width // divisor)
    y, x = np.mgrid[0:height, 0:width] + 0.5
    opacity = (np.hypot(x - width / 2, y - height / 2) < 10 / divisor + 1).astype(np.float32)
    frame = Frame(np.zeros((height, width, 3), np.uint8), opacity, opacity, 0, 1, 1, 0.0)
    cropped = crop.cropped(frame)
    assert cropped.resolution == pytest.approx((256 // divisor, 128 // divisor), abs=1)
    rows, columns = cropped.opacity.nonzero()
    expected = cropped.resolution[0] / 2 + pan[0] * 128 / divisor, cropped.resolution[1] / 2 + pan[1] * 128 / divisor
    inside = 0 < expected[0] < cropped.resolution[0] and 0 < expected[1] < cropped.resolution[1]
    if inside:
        assert columns.mean() + 0.5 == pytest.approx(expected[0], abs=1.5)
        assert rows.mean() + 0.5 == pytest.approx(expected[1], abs=1.5)


@pytest.mark.parametrize("view", orbit.VIEWS)
def test_usual_views_keep_the_distance(view: str) -> None:
    turned = orbit.seen_from(CAMERA, view)
    assert (turned.azimuth, turned.elevation) == orbit.VIEWS[view]
    assert replace(turned, azimuth=CAMERA.azimuth, elevation=CAMERA.elevation) == CAMERA


@pytest.mark.parametrize("panel, pan", [((400, 300), (0.0, 0.0)), ((300, 500), (0.2, -0.1))])
def test_a_photo_lies_over_the_view_where_its_object_is(model: Model, panel: tuple[int, int], pan: tuple[float, float]):
    photo = replace(model.camera(0.7, 0.3), distance=1.4, focal=900.0, width=640, height=480)
    camera = orbit.photo_camera(photo, model)
    left, top, right, bottom = orbit.photo_box(photo, camera, panel, pan)
    assert (right - left, bottom - top) == pytest.approx((0.8 * min(panel), 0.6 * min(panel)))
    corner = torch.tensor([[0.1, -0.2, 0.3]])
    crop = orbit.fit_to_panel(camera, *panel, min(panel), pan)
    projected = crop.camera.project(corner)[0] - torch.tensor([crop.left, crop.top])
    relative = photo.project(corner)[0] / torch.tensor([640.0, 480.0])
    expected = left + float(relative[0]) * (right - left), top + float(relative[1]) * (bottom - top)
    assert projected.tolist() == pytest.approx(expected, abs=1.0)  # views are moved by whole px


def test_a_photo_lies_over_the_view_from_its_camera_alone(model: Model) -> None:
    photo = replace(model.camera(0.7, 0.3), focal=900.0, width=640, height=480)
    camera = orbit.photo_camera(photo, model)
    for moved in (orbit.turned(camera, 0.01, 0.0), orbit.zoomed(camera, 1, model)):
        assert orbit.photo_box(photo, moved, (400, 300), (0.0, 0.0)) is None
