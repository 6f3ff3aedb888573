import math

import pytest
import torch

from core.classifiers.viewpoint import (
    SIDE,
    ViewpointClassifier,
    crop_to_object,
    direction_weights,
    directions,
    predict_viewpoint,
    viewpoint_nll,
    with_witness,
)


def square(left: int, top: int, size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A square, dark above and light below, on white."""
    pixels = torch.ones(60, 80, 3)
    mask = torch.zeros(60, 80, dtype=torch.bool)
    mask[top : top + size, left : left + size] = True
    pixels[mask] = 0.2
    pixels[top + size // 2 : top + size, left : left + size] = 0.8
    return pixels, mask


def test_the_crop_is_independent_of_position_size_and_background():
    small = crop_to_object(*square(5, 7, 24))
    large = crop_to_object(*square(30, 4, 48))
    assert small.shape == (4, SIDE, SIDE)
    assert float((small - large).abs().mean()) < 0.02
    assert float(small[3].mean()) == pytest.approx(1 / 1.12**2, abs=0.02)
    assert float(small[:3, 0].min()) > 0.99  # white around it
    assert float(small[0, SIDE // 4, SIDE // 2]) == pytest.approx(0.2, abs=0.02)
    pixels, mask = square(20, 10, 30)
    noisy = torch.where(mask[..., None], pixels, torch.rand(60, 80, 3))
    assert torch.allclose(crop_to_object(pixels, mask), crop_to_object(noisy, mask), atol=1e-6)


def test_directions_are_nearest_to_themselves_and_probabilities_add_up():
    weights = direction_weights(*directions())
    assert torch.allclose(weights.sum(-1), torch.ones(len(weights)), atol=1e-5)
    assert torch.equal(weights.argmax(-1), torch.arange(len(weights)))
    torch.manual_seed(0)
    probability = predict_viewpoint(ViewpointClassifier().eval(), *square(20, 10, 30))
    assert float(probability.sum()) == pytest.approx(1, abs=1e-5)
    assert float(probability.min()) > 1e-4


def test_the_likeliest_camera_has_no_nll_and_its_opposite_has():
    azimuth, elevation = directions()
    probability = torch.full_like(azimuth, 1e-4)
    probability[30] = 1.0
    likeliest, opposite = viewpoint_nll(
        probability, azimuth[30] + torch.tensor([0.0, math.pi]), elevation[30].expand(2)
    )
    assert float(likeliest) == pytest.approx(0, abs=1e-3)
    assert float(opposite) > 3


def test_a_witness_raises_its_direction_most_and_its_mirror_image_next():
    azimuth, elevation = directions()
    uniform = torch.full_like(azimuth, 1 / len(azimuth))
    posterior = with_witness(uniform, math.radians(60), math.radians(25))
    assert float(posterior.sum()) == pytest.approx(1, abs=1e-5)

    def at(degrees: float, height: float) -> float:
        return float(
            posterior[((azimuth - math.radians(degrees)).abs() + (elevation - math.radians(height)).abs()).argmin()]
        )

    assert at(60, 25) > 2 * at(300, 25) > 4 * at(180, 25) > 0
    assert at(60, 25) > at(60, 40) > 3 * at(60, 78) > 0
    torch.testing.assert_close(with_witness(uniform, math.radians(60 - 720), math.radians(25)), posterior)


def test_a_witness_that_contradicts_a_certain_classifier_raises_its_own_direction():
    azimuth, elevation = directions()
    certain = torch.full_like(azimuth, 0.05 / len(azimuth))
    certain[30] += 0.95
    posterior = with_witness(certain, float(azimuth[30]) + math.pi / 2, float(elevation[30]))
    witnessed = 30 + 6
    assert elevation[witnessed] == elevation[30]
    assert 0.8 < float(posterior[30]) < 0.95 < 50 * float(posterior[witnessed])
    assert float(posterior[witnessed]) > 10 * float(certain[witnessed])
