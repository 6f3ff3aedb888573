from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.camera import Camera
from viewer.activities.frame_budget import FrameBudget

BUDGET = 1 / 30  # s


def image(width: int, height: int | None = None) -> Camera:
    return Camera(0.0, 0.0, 2.0, 500.0, width, height or width)


def drag(budget: FrameBudget, rates: list[float]) -> list[int]:
    """Return the divisors of first frames on a machine that traces so many rays a second, frame by frame."""
    divisors = []
    camera = image(512)
    for rate in rates:
        divisors.append(budget.divisors(camera)[0])
        rays = camera.width * camera.height // divisors[-1] ** 2
        budget.observe(rays, rays / rate)
    return divisors


@given(st.floats(1e3, 1e8))
def test_the_first_frame_is_the_finest_within_the_budget(rate: float) -> None:
    budget = FrameBudget()
    (divisor,) = set(drag(budget, 60 * [rate])[-30:])
    seconds = 512**2 / divisor**2 / rate
    assert seconds <= BUDGET * 1.01 or divisor == 8  # 64 px
    assert divisor == 1 or seconds > 0.17 * BUDGET  # the next finer one takes up to 4 times as long


@given(st.floats(2e4, 1e7), st.lists(st.floats(0.9, 1.1), min_size=40, max_size=40))
def test_sizes_do_not_alternate(rate: float, noise: list[float]) -> None:
    divisors = drag(FrameBudget(), [rate * factor for factor in (*30 * [1.0], *noise)])
    changes = sum(divisor != next_divisor for divisor, next_divisor in pairwise(divisors[30:]))
    assert changes <= 1


def test_one_disturbance_coarsens_by_a_level_or_two_and_is_soon_forgotten() -> None:
    usual = 512**2 / 4**2 / BUDGET * 1.5
    divisors = drag(FrameBudget(), [*30 * [usual], usual / 100, *30 * [usual]])
    assert divisors[30] == 4 < divisors[31] <= 6 and divisors[-10:] == 10 * [4]


@given(st.lists(st.integers(64, 2000), min_size=1, max_size=30))
def test_dragging_an_edge_of_the_view_keeps_the_pixels_of_the_first_image(heights: list[int]) -> None:
    budget = FrameBudget(512**2 / 4**2 / BUDGET)
    for height in heights:
        first = budget.divisors(image(2 * height, height))[0]
        assert first == 1 or height // first >= 64
        assert 2 * height**2 / first**2 <= 512**2 / 4**2 or height / first < 2 * 64
    assert budget.divisors(image(512))[0] in (4, 5)


@pytest.mark.parametrize("divisor", [24, 8, 4, 3, 2, 1])
def test_stages_end_at_full_size_twice(divisor: int) -> None:
    stages = FrameBudget(2000**2 / divisor**2 / BUDGET * 1.001).divisors(image(2000))
    assert stages[0] == divisor
    assert stages[-2:] == (1, 1)
    assert all(stage > next_stage for stage, next_stage in pairwise(stages[:-1]))
