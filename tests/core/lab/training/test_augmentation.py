import math

import pytest
import torch

from core.classifiers.viewpoint import CROP_MARGIN, SIDE
from core.lab.training.augmentation import augment_photo, mirror, recrop


def half_images(count: int) -> torch.Tensor:
    images = torch.zeros(count, 4, SIDE, SIDE)
    images[:, 3, :, : SIDE // 2] = 1.0
    return images


def test_a_mirrored_object_is_seen_from_the_other_side_of_its_front():
    found, azimuth = mirror(half_images(64), torch.full((64,), 0.3), torch.Generator().manual_seed(0))
    mirrored = found[:, 3, :, SIDE // 2 :].mean((1, 2)) > found[:, 3, :, : SIDE // 2].mean((1, 2))
    assert 16 < int(mirrored.sum()) < 48
    assert torch.allclose(azimuth, torch.where(mirrored, math.pi - 0.3, torch.tensor(0.3)))


@pytest.mark.parametrize("seed", range(4))
def test_photos_stay_images_and_keep_something_of_the_object(seed: int):
    images = torch.ones(96, 4, SIDE, SIDE)
    images[:, 3] = 0
    images[:, :, 12:36, 8:40] = torch.tensor([0.3, 0.5, 0.2, 1.0])[:, None, None]
    found, _ = augment_photo(images, torch.zeros(96), torch.Generator().manual_seed(seed))
    assert bool(torch.isfinite(found).all())
    assert float(found.min()) >= -1e-4
    assert float(found.max()) <= 1 + 1e-4
    assert float(found[:, 3].mean((1, 2)).min()) > 0.02
    off = found[:, 3:].expand(-1, 3, -1, -1) == 0
    torch.testing.assert_close(found[:, :3][off], torch.ones(int(off.sum())), atol=1e-4, rtol=0)


def test_an_object_in_a_corner_fills_its_crop_and_nothing_stays_nothing():
    images = torch.ones(1, 4, SIDE, SIDE)
    images[:, 3] = 0
    images[:, 3, :12, 36:] = 1.0
    mask = recrop(images)[0, 3] > 0.5
    rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
    for found in (rows, columns):
        assert len(found) == pytest.approx(SIDE / CROP_MARGIN, abs=1.5)
        assert float(found.float().mean()) == pytest.approx((SIDE - 1) / 2, abs=0.6)
    images = torch.ones(1, 4, SIDE, SIDE)
    images[:, 3] = 0
    torch.testing.assert_close(recrop(images), images)
