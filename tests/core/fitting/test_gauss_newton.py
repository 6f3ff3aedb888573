"""Quadratics are those of the objective, and strides go down."""

import math

import pytest
import torch

from core.fitting import gauss_newton as newton
from core.fitting import hypotheses
from core.fitting.gauss_newton import quadratic, spread, stride, tried
from core.fitting.hypotheses import Numbers, Objective, Pool, aimed, judged
from core.fitting.observations import Drawn, Target, draw
from core.fitting.schedule import Stage
from core.models.model import Model
from tests.core.tiny import photo_of

STAGE = Stage(3, 4, 96, 24, (100, 100), math.inf, 0.3)
BY = Objective(1e-4)
FREE = torch.tensor([[True, True, True, True, False, False]])


def drawn_of(model: Model) -> Drawn:
    photo = photo_of(model, model.codes[0], model.camera(0.5, 0.5))
    return draw([Target.of(photo, model)], STAGE.rays, torch.Generator().manual_seed(0))


def numbers_of(count: int = 3) -> Numbers:
    generator = torch.Generator().manual_seed(0)
    return Numbers(
        0.5 + 0.2 * torch.rand(count, 1, 2, generator=generator),
        0.1 * torch.randn(count, 1, generator=generator),
        torch.full((count, 1), 0.1),
        torch.zeros(count, 1, 2),
        torch.randn(count, 2, generator=generator),
        torch.randn(count, 2, generator=generator),
    )


@pytest.mark.parametrize("by", [BY, Objective(1e-4, forgiving=0.1)])
def test_its_objective_and_slope_are_those_of_hypotheses(tiny: Model, monkeypatch: pytest.MonkeyPatch, by: Objective):
    monkeypatch.setattr(newton, "_KEPT", 1)
    monkeypatch.setattr(hypotheses, "_kept", lambda samples: samples)
    numbers, drawn = Numbers(*(part.requires_grad_() for part in numbers_of())), drawn_of(tiny)
    found = quadratic(tiny, Numbers(*(part.detach() for part in numbers)), drawn, None, STAGE, by)
    expected = judged(tiny, numbers, drawn, STAGE.samples, by)
    torch.testing.assert_close(found.objective, expected.objective, rtol=0.05, atol=1e-3)
    slopes = torch.autograd.grad(expected.objective.sum(), numbers)
    camera = torch.cat((slopes[0][:, 0], slopes[1], slopes[2], slopes[3][:, 0]), -1)
    whole = torch.cat((camera, slopes[4], slopes[5]), -1) / 2
    for one, other in zip(found.slope, whole, strict=True):
        assert float(torch.cosine_similarity(one, other, dim=0)) > 0.98
    assert bool((found.bend.diagonal(dim1=1, dim2=2) >= 0).all())


@pytest.mark.parametrize("zoom", [-0.3, 0.0, 0.3])
def test_rays_turn_with_every_number_of_a_camera_as_by_small_steps(tiny: Model, zoom: float):
    drawn, numbers = drawn_of(tiny), numbers_of(1)
    at = numbers._replace(zoom=torch.full((1, 1), zoom), shift=torch.tensor([[[0.05, -0.08]]]))
    parts, small = ((0, 0), (0, 1), (1, None), (2, None), (3, 0), (3, 1)), 1e-3
    for slope, (part, axis) in zip(newton._aims(at, aimed(tiny, at, drawn)), parts, strict=True):
        there = []
        for step in (-small, small):
            moved = at[part].clone()
            moved[..., slice(None) if axis is None else axis] += step
            rays = aimed(tiny, Numbers(*at[:part], moved, *at[part + 1 :]), drawn)
            there.append((rays.origins.expand_as(rays.directions), rays.directions))
        for index in range(2):
            expected = (there[1][index] - there[0][index]) / (2 * small)
            torch.testing.assert_close(slope[index].expand_as(expected), expected, atol=2e-3, rtol=2e-3)


def test_closed_directions_do_not_move(tiny: Model):
    one, stage = Pool.of(Numbers(*(part[:1] for part in numbers_of()))), STAGE._replace(ranks=(2, 2))
    there = tried(tiny, one, drawn_of(tiny), stage, BY, FREE, ((1, 1), (2, 1), (1, 2)))
    moved = [(part - start).abs() > 0 for part, start in zip(there[4:], one.numbers[4:], strict=True)]
    assert moved[0].tolist() == [[True, False], [True, True], [True, False]]
    assert moved[1].tolist() == [[True, False], [True, False], [True, True]]
    whole = tried(tiny, one, drawn_of(tiny), stage, BY, FREE, ((2, 2),))
    assert bool((whole.angles != one.numbers.angles).all())


def test_a_camera_may_be_the_further_off_the_more_else_can_make_up_for_it(tiny: Model):
    one, drawn = Pool.of(Numbers(*(part[:1] for part in numbers_of()))), drawn_of(tiny)
    turned = torch.tensor([[True, True, False, False, False, False]])

    def off(ranks: tuple[int, int], free: torch.Tensor) -> float:
        return spread(tiny, one, drawn, STAGE._replace(ranks=ranks), BY, free, 0)

    alone, away, all_free = off((1, 1), turned), off((1, 1), FREE), off((2, 2), FREE)
    assert 0 < alone <= away <= all_free < math.pi
    assert alone < all_free
    assert off((2, 2), torch.zeros_like(turned)) == 0


def test_two_views_share_codes_and_not_cameras(tiny: Model):
    photos = [photo_of(tiny, tiny.codes[0], tiny.camera(azimuth, 0.5)) for azimuth in (0.5, 2.5)]
    drawn = draw([Target.of(photo, tiny) for photo in photos], 32, torch.Generator().manual_seed(0))
    one = numbers_of(2)
    both = Numbers(*(part.repeat(1, 2, *[1] * (part.ndim - 2)) for part in one[:4]), *one[4:])
    found = quadratic(tiny, both, drawn, None, STAGE, BY)
    assert found.bend.shape == (2, 16, 16)
    assert not bool(found.bend[:, :6, 6:12].any())
    assert bool(found.bend[:, 6:10, 12:].any())


def test_a_given_camera_stays_wherever_it_is(tiny: Model):
    one = numbers_of(1)
    beyond = one._replace(angles=torch.full((1, 1, 2), math.pi / 2), distance=torch.full((1, 1), -2.0))
    drawn, still = drawn_of(tiny), torch.zeros(1, 6, dtype=torch.bool)
    pool = stride(tiny, Pool.of(beyond), drawn, torch.zeros_like(drawn.opaque), STAGE, BY, still)
    assert torch.equal(pool.numbers.angles, beyond.angles)
    assert torch.equal(pool.numbers.distance, beyond.distance)
    free = stride(tiny, Pool.of(beyond), drawn, torch.zeros_like(drawn.opaque), STAGE, BY, FREE).numbers
    assert float(free.angles[..., 1]) < math.pi / 2
    assert float(free.distance) >= -1


def test_strides_go_down_and_leave_alone_what_is_given(tiny: Model):
    pool = first = Pool.of(numbers_of())
    drawn = drawn_of(tiny)
    free = torch.tensor([[True, False, True, False, False, False]])
    costs = []
    for _ in range(STAGE.steps + 1):
        pool = stride(tiny, pool, drawn, torch.zeros_like(drawn.opaque), STAGE, BY, free)
        costs.append(pool.cost)
    assert bool((costs[-1] < costs[0]).all())
    assert bool((costs[-1] < 0.7 * costs[0]).any())
    assert torch.equal(pool.numbers.angles[..., 1], first.numbers.angles[..., 1])
    assert not torch.equal(pool.numbers.angles[..., 0], first.numbers.angles[..., 0])
    assert torch.equal(pool.numbers.zoom, first.numbers.zoom)
    assert torch.equal(pool.numbers.shift, first.numbers.shift)


def test_one_that_diverged_stays_out_and_the_others_go_on(tiny: Model):
    drawn = drawn_of(tiny)

    def strode(numbers: Numbers) -> Pool:
        pool = Pool.of(numbers)
        for _ in range(STAGE.steps):
            pool = stride(tiny, pool, drawn, torch.zeros_like(drawn.opaque), STAGE, BY, FREE)
        return pool

    numbers = numbers_of()
    numbers.shape[1] = torch.nan
    pool, without = strode(numbers), strode(numbers_of())
    assert pool.cost.isfinite().tolist() == [True, False, True]
    torch.testing.assert_close(pool.cost[[0, 2]], without.cost[[0, 2]], rtol=0.05, atol=1e-4)


@pytest.mark.parametrize("wrong", [math.nan, -math.nan, math.inf])
@pytest.mark.parametrize("part", Numbers._fields)
def test_whatever_number_is_not_finite_the_objective_says_so(tiny: Model, part: str, wrong: float):
    """Rectifiers forget a NaN: it must show beside the field too."""
    numbers, drawn = numbers_of(), drawn_of(tiny)
    getattr(numbers, part)[1] = wrong
    with torch.no_grad():
        for found in (judged(tiny, numbers, drawn, 24, BY), quadratic(tiny, numbers, drawn, None, STAGE, BY)):
            assert found.objective.isfinite().tolist() == [True, False, True]
