from dataclasses import replace

import pytest

from core.models.model import Model
from viewer.values import orbit
from viewer.values.view_request import ViewRequest, ViewSettings


@pytest.fixture
def request_(model: Model) -> ViewRequest:
    return ViewRequest(model[0], orbit.home(model), ViewSettings((300, 200), (0.1, 0.0), 128, 96))


def test_a_view_request_gives_image_size_and_crop(request_: ViewRequest) -> None:
    assert (request_.full, request_.preview) == (200, 128)
    crop = request_.crop(request_.full)
    assert (crop.width, crop.height) == (300, 200)
    assert crop.camera.width == 340  # panned: rendered wider, and cropped
    free = replace(request_, settings=replace(request_.settings, pan=(0.0, 0.0), covered=40))
    crop = free.crop(100)
    assert crop.camera.height / 2 - crop.top == (100 - 20) / 2  # the object's middle, of the image's rows
    assert ViewSettings(opengl=True).baked
    assert not ViewSettings(opengl=True, mode="normals").baked
    assert not ViewSettings().baked
