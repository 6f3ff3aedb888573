import math

import pytest
import torch

from core.classifiers.viewpoint import CROP_MARGIN, SIDE
from core.lab.training.augmentation import augment_photo, mirror, recrop


def half_images(count: int) -> torch.Tensor:
    images = torch.zeros(count, 4, SIDE, SIDE)
    images[:, 3, :, : SIDE // 2] = 1.0
    return images


def test_mirroring_half_of_the_images_mirrors_their_azimuths():
    augmented, azimuth = mirror(half_images(64), torch.full((64,), 0.3), torch.Generator().manual_seed(0))
    mirrored = augmented[:, 3, :, SIDE // 2 :].mean((1, 2)) > augmented[:, 3, :, : SIDE // 2].mean((1, 2))
    assert 16 < int(mirrored.sum()) < 48
    assert torch.allclose(azimuth, torch.where(mirrored, math.pi - 0.3, torch.tensor(0.3)))


@pytest.mark.parametrize("seed", range(4))
def test_augmented_photos_stay_in_range_and_show_the_object(seed: int):
    images = torch.ones(96, 4, SIDE, SIDE)
    images[:, 3] = 0
    images[:, :, 12:36, 8:40] = torch.tensor([0.3, 0.5, 0.2, 1.0])[:, None, None]
    augmented, _ = augment_photo(images, torch.zeros(96), torch.Generator().manual_seed(seed))
    assert bool(torch.isfinite(augmented).all())
    assert float(augmented.min()) >= -1e-4
    assert float(augmented.max()) <= 1 + 1e-4
    assert float(augmented[:, 3].mean((1, 2)).min()) > 0.02
    off = augmented[:, 3:].expand(-1, 3, -1, -1) == 0
    torch.testing.assert_close(augmented[:, :3][off], torch.ones(int(off.sum())), atol=1e-4, rtol=0)


def test_an_object_in_a_corner_fills_its_crop_and_empty_images_stay_unchanged():
    images = torch.ones(1, 4, SIDE, SIDE)
    images[:, 3] = 0
    images[:, 3, :12, 36:] = 1.0
    mask = recrop(images)[0, 3] > 0.5
    for axis in (0, 1):
        lines = mask.any(axis).nonzero()[:, 0]
        assert len(lines) == pytest.approx(SIDE / CROP_MARGIN, abs=1.5)
        assert float(lines.float().mean()) == pytest.approx((SIDE - 1) / 2, abs=0.6)
    images = torch.ones(1, 4, SIDE, SIDE)
    images[:, 3] = 0
    torch.testing.assert_close(recrop(images), images)
