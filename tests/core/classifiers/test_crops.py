import pytest
import torch

from core.classifiers.crops import SIDE, crop_to_object


def square(left: int, top: int, size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A square, dark above and light below, on white."""
    pixels, mask = torch.ones(60, 80, 3), torch.zeros(60, 80, dtype=torch.bool)
    mask[top : top + size, left : left + size] = True
    pixels[mask] = 0.2
    pixels[top + size // 2 : top + size, left : left + size] = 0.8
    return pixels, mask


def test_an_image_looks_the_same_wherever_and_however_large_the_object_is():
    small, large = crop_to_object(*square(5, 7, 24)), crop_to_object(*square(30, 4, 48))
    assert small.shape == (4, SIDE, SIDE)
    assert float((small - large).abs().mean()) < 0.02
    assert float(small[3].mean()) == pytest.approx(1 / 1.12**2, abs=0.02)
    assert float(small[:3, 0].min()) > 0.99  # white around it
    assert float(small[0, SIDE // 4, SIDE // 2]) == pytest.approx(0.2, abs=0.02)


def test_what_lies_beside_the_object_is_not_seen():
    pixels, mask = square(20, 10, 30)
    beside = torch.where(mask[..., None], pixels, torch.rand(60, 80, 3))
    assert torch.allclose(crop_to_object(pixels, mask), crop_to_object(beside, mask), atol=1e-6)
