import math

import pytest

from core.geometry.camera import Camera
from viewer.values.camera_text import camera_from_text, camera_text

CAMERA = Camera(1.234, -0.3, 1.7, 140.0, 128, 96)


def test_a_camera_comes_back_from_its_text_and_what_is_not_named_stays() -> None:
    other = Camera(0.0, 0.0, 1.0, 50.0, 128, 96)
    back = camera_from_text(f"from a mail: {camera_text(CAMERA)}.", other)
    assert back.azimuth == pytest.approx(CAMERA.azimuth, abs=1e-5)
    assert back.elevation == pytest.approx(CAMERA.elevation, abs=1e-5)
    assert (back.distance, back.focal) == pytest.approx((CAMERA.distance, CAMERA.focal), rel=1e-4)
    assert camera_from_text("Azimuth: 90", CAMERA).azimuth == pytest.approx(math.pi / 2)
    assert camera_from_text("Azimuth: 90", CAMERA).distance == CAMERA.distance


@pytest.mark.parametrize("text", ["", "hello", "azimuth=many", "distance=-1", "elevation=100"])
def test_what_is_no_camera_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        camera_from_text(text, CAMERA)
