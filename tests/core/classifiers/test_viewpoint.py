import math

import pytest
import torch

from core.classifiers.viewpoint import (
    ViewpointClassifier,
    direction_weights,
    directions,
    predict_viewpoint,
    viewpoint_nll,
    with_azimuth,
)
from tests.core.classifiers.test_crops import square


def test_directions_are_nearest_to_themselves():
    shares = direction_weights(*directions())
    assert torch.allclose(shares.sum(-1), torch.ones(len(shares)), atol=1e-5)
    assert torch.equal(shares.argmax(-1), torch.arange(len(shares)))


def test_probabilities_add_up_and_none_is_lost():
    torch.manual_seed(0)
    found = predict_viewpoint(ViewpointClassifier().eval(), *square(20, 10, 30))
    assert float(found.sum()) == pytest.approx(1, abs=1e-5)
    assert float(found.min()) > 1e-4


def test_the_likeliest_camera_has_no_nll_and_its_opposite_has():
    azimuth, elevation = directions()
    probability = torch.full_like(azimuth, 1e-4)
    probability[30] = 1.0
    at, twin = viewpoint_nll(probability, azimuth[30] + torch.tensor([0.0, math.pi]), elevation[30].expand(2))
    assert float(at) == pytest.approx(0, abs=1e-3)
    assert float(twin) > 3


def test_a_witness_raises_its_azimuth_most_and_its_mirror_image_next():
    azimuth, _ = directions()
    uniform = torch.full_like(azimuth, 1 / len(azimuth))
    found = with_azimuth(uniform, math.radians(60))
    assert float(found.sum()) == pytest.approx(1, abs=1e-5)
    at, mirrored, beside = (found[int((azimuth - math.radians(one)).abs().argmin())] for one in (60, 300, 180))
    assert at > 2 * mirrored > 4 * beside > 0
    torch.testing.assert_close(with_azimuth(uniform, math.radians(60 - 720)), found)


def test_a_witness_cannot_overrule_certainty():
    azimuth, _ = directions()
    certain = torch.zeros_like(azimuth)
    certain[5] = 1.0
    torch.testing.assert_close(with_azimuth(certain, float(azimuth[5]) + math.pi), certain)
