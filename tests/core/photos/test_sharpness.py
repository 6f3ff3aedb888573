"""Sharpness of images of known blur."""

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from core.photos.sharpness import edge_softness, measure_blur, measure_sharpness


def disc(radius: float = 20.0) -> np.ndarray:
    """A dark disc with a bright stripe, anti-aliased."""
    y, x = np.mgrid[:64, :64] + 0.5
    image = np.clip(np.hypot(y - 32, x - 32) - radius + 0.5, 0, 1)
    image[28:36, 20:44] = 0.8
    return image.astype(np.float32)


def as_pixels(grey: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(grey)[..., None].expand(-1, -1, 3)


@pytest.mark.parametrize("blur", [1.5, 2.0, 3.0])
def test_the_blur_of_an_image_is_measured(blur: float):
    assert measure_blur(as_pixels(gaussian_filter(disc(), blur))) == pytest.approx(blur, rel=0.25)


def test_sharp_images_are_not_blurred_and_their_masks_may_be_soft():
    noise = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    for grey in (disc(), (disc() > 0.5).astype(np.float32), noise, np.ones((64, 64), np.float32)):
        assert measure_blur(as_pixels(grey)) < 0.3
    opacity = torch.from_numpy(1 - np.clip(np.hypot(*(np.mgrid[:64, :64] - 31.5)) - 20, 0, 1).astype(np.float32))
    soft = torch.from_numpy(gaussian_filter(opacity.numpy(), 2.0))
    assert edge_softness(opacity, 0.0) == 0
    assert edge_softness(soft, 0.0) == pytest.approx(2.0, rel=0.3)
    assert edge_softness(soft, 2.5) == 0
    assert edge_softness(torch.zeros(8, 8), 0.0) == 0


def test_a_blurred_image_is_less_sharp() -> None:
    grey = np.random.default_rng(0).random((32, 32)).astype(np.float32)
    values = [measure_sharpness(gaussian_filter(grey, blur)) for blur in (0.0, 0.5, 1.0, 2.0)]
    assert values == sorted(values, reverse=True)
    assert values[0] > 10 * values[-1]
