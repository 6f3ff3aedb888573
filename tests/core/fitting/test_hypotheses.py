import math
from dataclasses import replace

import pytest
import torch

from core.fitting.hypotheses import (
    FRAMED_SPREAD,
    STRAY_SPREADS,
    Numbers,
    Objective,
    Pool,
    astray,
    cameras,
    joined,
    judged,
    rival_of,
)
from core.fitting.observations import Target, draw
from core.geometry.camera import Camera
from core.models.model import Model
from tests.core.tiny import photo_of, tiny_model

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


def random_numbers(count: int) -> Numbers:
    generator = torch.Generator().manual_seed(0)
    return Numbers(
        torch.rand(count, 1, 2, generator=generator),
        0.1 * torch.randn(count, 1, generator=generator),
        torch.zeros(count, 1),
        torch.zeros(count, 1, 2),
        torch.randn(count, 2, generator=generator),
        torch.randn(count, 2, generator=generator),
    )


def test_a_rival_is_the_best_of_another_basin_or_the_twin():
    pool, views = Pool.of(random_numbers(3)), torch.tensor([True])
    pool.numbers.angles[:, 0] = torch.tensor([[0.0, 0.2], [0.1, 0.2], [2.0, 0.2]])
    pool = replace(pool, cost=torch.tensor([1.0, 2.0, 3.0]))
    assert rival_of(pool, pool, views).start.tolist() == [2]
    near = pool[torch.tensor([0, 1])]
    assert float(rival_of(near, near, views).numbers.angles[0, 0, 0]) == pytest.approx(math.pi)
    assert math.isinf(rival_of(near, near, views).cost)  # nobody has asked it
    lost = replace(pool, cost=torch.tensor([1.0, 2.0, math.inf]))
    assert rival_of(lost, joined(lost, lost), views).start.tolist() == [0]


def test_a_hypothesis_that_diverged_does_not_lead():
    pool = Pool.of(random_numbers(3))
    assert pool[torch.tensor([2, 0])].start.tolist() == [2, 0]
    costs = replace(pool, cost=torch.tensor([3.0, math.inf, 2.0]))
    assert costs.leader == 2
    with pytest.raises(ValueError, match="diverged"):
        _ = replace(pool, cost=torch.full((3,), math.inf)).leader


def test_hypotheses_in_a_batch_are_judged_as_alone(tiny: Model):
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.5, 0.5))
    drawn = draw([Target.of(photo, tiny)], 64, torch.Generator().manual_seed(0))
    numbers = random_numbers(3)
    together = judged(tiny, numbers, drawn, 16, Objective(1e-4)).objective
    for index in range(3):
        one = Numbers(*(part[index : index + 1] for part in numbers))
        alone = judged(tiny, one, drawn, 16, Objective(1e-4)).objective
        torch.testing.assert_close(alone[0], together[index], atol=1e-3, rtol=1e-2)  # bfloat16, in another order


def test_the_true_hypothesis_is_the_best(tiny: Model):
    truth = tiny.camera(0.5, 0.5)
    drawn = draw([Target.of(photo_of(tiny, tiny.codes[0], truth), tiny)], 256, torch.Generator().manual_seed(0))
    numbers = random_numbers(4)
    numbers.angles[1, 0] = torch.tensor([truth.azimuth, truth.elevation])
    numbers.distance[1] = 0
    numbers.shape[1] = tiny.codes.shape_space.coordinates(tiny.codes[0].shape)
    numbers.texture[1] = tiny.codes.texture_space.coordinates(tiny.codes[0].texture)
    assert int(judged(tiny, numbers, drawn, 32, Objective(0.0)).objective.argmin()) == 1
