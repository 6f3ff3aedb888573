import math

import numpy as np
import pytest
import torch

from core.fitting.hypotheses import Parameters, image_points
from core.fitting.photo_views import photo_view
from core.geometry.camera import pixel_centres
from core.models.model import Model
from core.models.photo_detail import compressed
from core.photos.photo import Photo


def dot_at(x: float, y: float, size: int) -> Photo:
    """A red dot on a square image."""
    far = (pixel_centres(size, size) - torch.tensor([x, y])).norm(dim=-1)
    inside = (far < 4).float()[..., None]
    pixels = 1 - inside * torch.tensor([0.0, 1.0, 1.0])
    return Photo(pixels, torch.ones(size, size, dtype=torch.bool))


@pytest.mark.parametrize("roll, shift", [(0.0, (0.1, -0.05)), (0.3, (0.0, 0.0)), (-0.2, (0.07, 0.04))])
def test_a_crop_is_turned_and_moved_to_where_the_camera_sees_it(
    model: Model, roll: float, shift: tuple[float, float]
) -> None:
    size = 2 * model.image_size
    x, y = 0.6 * size, 0.35 * size
    transform = torch.tensor([0.0, roll, *shift])
    camera = model.camera(0.3, 0.2).resized(size, size)
    detail = photo_view(model, dot_at(x, y, size), camera, transform)
    focal = model.focal * size / model.image_size
    none = torch.zeros(1, 1)
    parameters = Parameters(torch.zeros(1, 1, 2), none, none, transform[None, None], none, none)
    pixel = (torch.tensor([[[x, y]]]) - size / 2) / focal
    expected = image_points(parameters, pixel)[0, 0, 0] * focal + size / 2
    rgba = detail.pixels().astype(float)
    redness = (rgba[..., 0] - rgba[..., 1]).clip(0)
    redness[redness < 60] = 0
    offset = (size - detail.camera.width) / 2
    rows, columns = np.mgrid[: rgba.shape[0], : rgba.shape[1]] + 0.5
    found = [(part * redness).sum() / redness.sum() + offset for part in (columns, rows)]
    np.testing.assert_allclose(found, expected, atol=0.3)


def test_the_image_is_cut_to_the_object_around_the_axis(model: Model) -> None:
    size = 64
    mask = torch.zeros(size, size, dtype=torch.bool)
    mask[28:36, 20:50] = True
    camera = model.camera(0.0, 0.0).resized(size, size)
    detail = photo_view(model, Photo(torch.rand(size, size, 3), mask), camera)
    assert detail.camera.focal == camera.focal
    assert 36 <= detail.camera.width <= 40 and detail.camera.width == detail.camera.height
    assert math.isclose(detail.pixels()[..., 3].sum() / 255, int(mask.sum()), rel_tol=0.01)


def test_the_finer_pixels_are_taken(model: Model) -> None:
    size = model.image_size
    fine = compressed(np.full((3 * size, 3 * size, 4), 255, np.uint8))
    photo = Photo(torch.ones(size, size, 3), torch.ones(size, size, dtype=torch.bool), fine=fine)
    detail = photo_view(model, photo, model.camera(0.0, 0.0).resized(size, size))
    assert detail.camera.height == 3 * size
    assert detail.camera.focal == pytest.approx(3 * model.focal)
