import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.fitting.fit import FitJob, fit
from core.fitting.hypotheses import Hypothesis, Parameters, image_points
from core.fitting.photo_views import detailed_instance, photo_view, resume_point
from core.geometry.camera import pixel_centres
from core.metrics import rotation_error
from core.models.model import Model
from core.models.photo_detail import BACKGROUND, compressed
from core.photos.photo import Photo
from tests.core.fitting.inputs import QUICK
from tests.core.tiny import photo_of


def dot_at(x: float, y: float, size: int) -> Photo:
    """A red dot on a square image."""
    far = (pixel_centres(size, size) - torch.tensor([x, y])).norm(dim=-1)
    inside = (far < 4).float()[..., None]
    pixels = 1 - inside * torch.tensor([0.0, 1.0, 1.0])
    return Photo(pixels, torch.ones(size, size, dtype=torch.bool))


@pytest.mark.parametrize("roll, shift", [(0.0, (0.1, -0.05)), (0.3, (0.0, 0.0)), (-0.2, (0.07, 0.04))])
def test_a_crop_is_turned_and_moved_into_the_camera(model: Model, roll: float, shift: tuple[float, float]):
    size = 2 * model.image_size
    x = 0.6 * size
    y = 0.35 * size
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
    centroid = [(coordinates * redness).sum() / redness.sum() + offset for coordinates in (columns, rows)]
    np.testing.assert_allclose(centroid, expected, atol=0.3)


def test_the_image_is_cropped_to_the_object_around_the_axis(model: Model) -> None:
    size = 64
    mask = torch.zeros(size, size, dtype=torch.bool)
    mask[28:36, 20:50] = True
    camera = model.camera(0.0, 0.0).resized(size, size)
    detail = photo_view(model, Photo(torch.rand(size, size, 3), mask), camera)
    assert detail.camera.focal == camera.focal
    assert 36 <= detail.camera.width <= 40 and detail.camera.width == detail.camera.height
    assert math.isclose(detail.pixels()[..., 3].sum() / 255, int(mask.sum()), rel_tol=0.01)


def test_fine_pixels_are_used_and_a_doubtful_mask_has_no_margin(model: Model) -> None:
    size = model.image_size
    fine = compressed(np.full((3 * size, 3 * size, 4), 255, np.uint8))
    photo = Photo(torch.ones(size, size, 3), torch.ones(size, size, dtype=torch.bool), fine=fine)
    detail = photo_view(model, photo, model.camera(0.0, 0.0).resized(size, size))
    assert detail.camera.height == 3 * size
    assert detail.camera.focal == pytest.approx(3 * model.focal)
    size = model.image_size
    photo = Photo(torch.rand(size, size, 3), torch.ones(size, size, dtype=torch.bool), mask_confidence=0.4)
    assert photo_view(model, photo, model.camera(0.0, 0.0)).outline_margin is None


def test_background_deep_in_a_solid_object_is_doubtful(tiny: Model) -> None:
    camera = tiny.camera(1.1, 0.3)
    instance = tiny[0]
    photo = photo_of(instance, camera)
    hidden = torch.zeros_like(photo.mask)
    rows = photo.mask.any(1).nonzero()[:, 0]
    hidden[int(rows.float().median()) :] = True
    half = replace(photo, mask=photo.mask & ~hidden)
    truncated = photo_view(tiny, half, camera, fitted=instance).pixels()[..., 3] / 255
    plain = photo_view(tiny, half, camera).pixels()[..., 3] / 255
    complete = photo_view(tiny, photo, camera, fitted=instance).pixels()[..., 3] / 255
    assert set(np.unique(plain)) == set(np.unique(complete)) == {0, 1}
    doubtful = (truncated > BACKGROUND) & (truncated < 0.5)
    assert 0.5 * int((photo.mask & hidden).sum()) < doubtful.sum() < 1.2 * int((photo.mask & hidden).sum())


def test_pixels_beyond_a_truncating_edge_are_doubtful(model: Model) -> None:
    size = model.image_size
    mask, unseen = torch.zeros(2, size, size, dtype=torch.bool)
    mask[size // 4 : size // 2, : size // 2], unseen[:, size // 2 :] = True, True
    photo = Photo(torch.rand(size, size, 3), mask, unseen=unseen, edge_error=0.5)
    view = photo_view(model, photo, model.camera(0.0, 0.0))
    opacity = view.pixels()[..., 3] / 255
    assert ((opacity > BACKGROUND) & (opacity < 0.5)).sum() == opacity.shape[0] * (opacity.shape[1] // 2)
    assert view.outline_margin == pytest.approx((0.2 / 128 * size + 0.5) / model.focal)


def test_only_a_single_photo_bounds_the_object(model: Model) -> None:
    photo = replace(dot_at(20.0, 20.0, model.image_size), mask_confidence=1.0)
    cameras = (model.camera(0.0, 0.0), model.camera(1.0, 0.0))
    for count, left_out, bounds in ((1, (), [True]), (2, (), [False, False]), (2, (1,), [True])):
        hypothesis = Hypothesis(0, 1.0, cameras[:count], model.mean, torch.zeros(count, 4))
        detail = detailed_instance((photo,) * count, hypothesis, left_out).detail
        assert detail is not None
        assert [view.outline_margin is not None for view in detail.views] == bounds


@pytest.mark.parametrize("cropped", [False, True])
def test_a_fit_resumes_with_the_photos_that_an_object_keeps(tiny: Model, cropped: bool) -> None:
    camera = tiny.camera(1.2, 0.3)
    photo = photo_of(tiny[0], camera)
    if cropped:  # moved and zoomed
        photo = replace(photo, cropped=True, scaled=True)
    job = FitJob((photo,), QUICK)
    *_, first = fit(tiny, job)
    photos, hypothesis = resume_point(first.instance)
    assert rotation_error(hypothesis.cameras[0], first.cameras[0]) < 1e-3
    *_, again = fit(tiny, replace(job, photos=photos, resume_from=hypothesis, settings=replace(QUICK, steps=4)))
    assert rotation_error(again.cameras[0], first.cameras[0]) < 3
    assert again.psnr > 25
    with pytest.raises(ValueError, match="no photos"):
        resume_point(tiny[0])
