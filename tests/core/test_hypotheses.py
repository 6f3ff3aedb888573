import math
from dataclasses import replace

import pytest
import torch

from core.camera import Camera
from core.hypotheses import FRAMED_SPREAD, STRAY_SPREADS, Numbers, Objective, astray, cameras
from tests.core.tiny import tiny_model

USUAL, GIVEN = STRAY_SPREADS, (math.inf, math.inf, math.inf)
FRAMED = (STRAY_SPREADS[0], FRAMED_SPREAD, STRAY_SPREADS[2])


def standing(distance: float, elevation: float = 0.5, views: int = 1, zoom: float = 0.0) -> Numbers:
    angles = torch.tensor([0.0, elevation]).expand(1, views, 2)
    away, lens = (torch.full((1, views), value) for value in (distance, zoom))
    return Numbers(angles, away, lens, torch.zeros(1, views, 2), torch.zeros(1, 2), torch.zeros(1, 2))


def by(*spreads: tuple[float, float, float]) -> Objective:
    return Objective(1e-4, spreads=torch.tensor(spreads))


def test_the_distance_of_the_training_pictures_costs_nothing():
    assert float(astray(standing(0.0), Objective(1e-4))) == 0


def test_a_picture_that_was_framed_says_less_about_its_distance():
    as_it_is, framed = (float(astray(standing(0.05), by(one))) for one in (USUAL, FRAMED))
    assert 0 < framed < as_it_is / 2


def test_every_picture_has_a_spread_of_its_own():
    alone = [float(astray(standing(0.05), by(one))) for one in (USUAL, FRAMED)]
    both = astray(standing(0.05, views=2), by(USUAL, FRAMED))
    torch.testing.assert_close(float(both), sum(alone) / 2)


def test_a_camera_below_the_ground_costs_something():
    assert float(astray(standing(0.0, elevation=-0.2), Objective(1e-4))) > 0


def test_a_given_camera_costs_nothing_wherever_it_stands():
    assert float(astray(standing(0.4, elevation=-0.5), by(GIVEN))) == 0


def test_another_lens_keeps_the_object_as_large_as_it_is():
    given = Camera(0.0, 0.0, 1.3, 131.25, 128, 128)
    model = replace(tiny_model(), distance=1.3)
    near, far = (cameras(model, standing(0.1, zoom=zoom), 0, [given])[0] for zoom in (0.0, 0.4))
    assert far.focal == pytest.approx(near.focal * math.exp(0.4))
    assert far.focal / far.distance == pytest.approx(near.focal / near.distance)
    assert float(astray(standing(0.0, zoom=0.4), Objective(1e-4))) > 0
