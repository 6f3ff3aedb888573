import math

import pytest
import torch

from core.classifiers.viewpoint import (
    ViewpointClassifier,
    direction_weights,
    directions,
    predict_viewpoint,
    viewpoint_nll,
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
