from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewer.activities.frame_budget import FrameBudget


def settled(cost: float, fixed: float = 0.0, frames: int = 400) -> list[int]:
    """Divisors of first images on a machine that takes ``fixed`` s and ``cost`` s for all pixels."""
    pace = FrameBudget()
    divisors = []
    for _ in range(frames):
        divisors.append(pace.divisor)
        pace.observe(pace.divisor, fixed + cost / pace.divisor**2)
    return divisors


@given(st.floats(1e-4, 50), st.floats(0, 0.03))
def test_the_first_frame_converges_to_the_finest_within_the_budget(cost: float, fixed: float) -> None:
    late = settled(cost, fixed)[-100:]
    slow = [divisor for divisor in late if fixed + cost / divisor**2 > FrameBudget().budget and divisor < 24]
    assert len(slow) <= 2
    usual = max(set(late), key=late.count)
    assert usual == 1 or fixed + cost / usual**2 > 0.7 * FrameBudget().budget or slow


@pytest.mark.parametrize(
    ("divisor", "seconds", "next_divisor"),
    [
        (8, [0.05], 12),
        (4, [3.0], 6),  # one disturbance does not throw the image away
        (8, [0.001, 0.001, 0.03, 0.001, 0.001], 8),  # a few quick images in a row make it finer
        (8, [0.001, 0.001, 0.001], 6),
    ],
)
def test_one_slow_frame_coarsens_and_three_quick_ones_refine(
    divisor: int, seconds: list[float], next_divisor: int
) -> None:
    pace = FrameBudget(divisor=divisor)
    for frame_seconds in seconds:
        pace.observe(divisor, frame_seconds)
    assert pace.divisor == next_divisor


@given(st.floats(0.04, 1), st.floats(1e-3, 50))
def test_fixed_time_does_not_coarsen_the_frame(fixed: float, cost: float) -> None:
    late = settled(cost, fixed)[-100:]
    usual = max(set(late), key=late.count)
    assert late.count(usual) >= 40
    assert usual == 24 or cost / usual**2 <= 0.5 * fixed
    assert usual == 1 or 4 * cost / usual**2 > 0.05 * fixed


def test_frames_of_another_size_do_not_change_the_budget() -> None:
    pace = FrameBudget()
    for _ in range(60):
        first = pace.divisors(256)[0]
        pace.observe(first, 0.08 + 0.02 / first**2)
    assert pace.divisor == 1
    pace = FrameBudget()
    pace.observe(4, 10.0)
    assert pace.divisor == 8
    pace = FrameBudget()

    def frame(height: int) -> int:
        first = pace.divisors(height)[0]
        pace.observe(first, 0.8 * (height / 512 / first) ** 2)
        return first

    before = [frame(512) for _ in range(60)][-1]
    assert before == 5
    assert {frame(100) for _ in range(20)} == {1}
    assert frame(512) == before


@given(st.floats(0.04, 1), st.floats(1e-3, 0.1), st.integers(10, 300))
def test_fixed_time_is_forgotten_once_it_has_gone(fixed: float, cost: float, frames: int) -> None:
    pace = FrameBudget()
    for _ in range(frames):
        pace.observe(pace.divisor, fixed + cost / pace.divisor**2)
    for _ in range(90):
        pace.observe(pace.divisor, 0.2 / pace.divisor**2)
    assert pace.limit == pace.budget
    assert pace.divisor in (2, 3, 4)


@pytest.mark.parametrize("divisor", [24, 8, 4, 3, 2, 1])
def test_stages_end_at_full_size_twice(divisor: int) -> None:
    stages = FrameBudget(divisor=divisor).divisors(2000)
    assert stages[0] == divisor
    assert stages[-2:] == (1, 1)
    assert all(before > after for before, after in pairwise(stages[:-1]))


@given(st.integers(1, 4000), st.floats(0, 10))
def test_no_first_image_is_lower_than_64_px(height: int, seconds: float) -> None:
    pace = FrameBudget()
    for _ in range(20):
        first = pace.divisors(height)[0]
        assert first == 1 or height // first >= 64
        assert first == pace.divisor
        pace.observe(first, seconds)


@given(st.floats(0.05, 5), st.integers(1, 200))
def test_the_frame_is_fine_again_soon_after_other_work_ends(busy: float, frames: int) -> None:
    pace = FrameBudget()
    for frame in range(frames):
        pace.observe(pace.divisor, busy / pace.divisor if frame % 9 else 0.02)
    for _ in range(30):  # a second of them
        pace.observe(pace.divisor, 0.004 / pace.divisor**2)
    assert pace.divisor == 1


@given(st.lists(st.integers(64, 2000), min_size=1, max_size=30))
def test_dragging_an_edge_of_the_view_keeps_the_pixels_of_the_first_image(heights: list[int]) -> None:
    pace = FrameBudget(divisor=4)
    for _ in range(20):
        first = pace.divisors(512)[0]
        pace.observe(first, 0.4 / first**2)
    for height in heights:
        first = pace.divisors(height)[0]
        assert first in (1, 24) or 0.6 < height / first / (512 / 4) < 1.7
    assert pace.divisors(512)[0] == 4
