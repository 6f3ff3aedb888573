import torch

from core.hypotheses import Numbers, Objective, astray


def standing(distance: float, elevation: float = 0.5, views: int = 1) -> Numbers:
    angles = torch.tensor([0.0, elevation]).expand(1, views, 2)
    return Numbers(
        angles, torch.full((1, views), distance), torch.zeros(1, views, 2), torch.zeros(1, 2), torch.zeros(1, 2)
    )


def test_the_distance_of_the_training_pictures_costs_nothing():
    assert float(astray(standing(0.0), Objective(1e-4))) == 0


def test_a_picture_that_was_framed_says_less_about_its_distance():
    as_it_is, framed = (float(astray(standing(0.05), Objective(1e-4, framed=(one,)))) for one in (False, True))
    assert 0 < framed < as_it_is / 2


def test_every_picture_has_a_spread_of_its_own():
    alone = [float(astray(standing(0.05), Objective(1e-4, framed=(one,)))) for one in (False, True)]
    both = astray(standing(0.05, views=2), Objective(1e-4, framed=(False, True)))
    torch.testing.assert_close(float(both), sum(alone) / 2)


def test_a_camera_below_the_ground_costs_something():
    assert float(astray(standing(0.0, elevation=-0.2), Objective(1e-4))) > 0
