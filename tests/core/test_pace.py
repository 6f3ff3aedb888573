from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.pace import Pace


def settled(cost: float, fixed: float = 0.0, frames: int = 60) -> list[int]:
    """Divisors of first pictures on a machine that takes ``fixed`` s and ``cost`` s for all pixels."""
    pace, found = Pace(), []
    for _ in range(frames):
        found.append(pace.divisor)
        pace.seen(pace.divisor, fixed + cost / pace.divisor**2)
    return found


@given(st.floats(1e-4, 50), st.floats(0, 0.02))
def test_the_first_picture_comes_to_fit_the_budget(cost: float, fixed: float) -> None:
    last = settled(cost, fixed)[-1]
    assert fixed + cost / last**2 <= Pace().budget or last == 24


@given(st.floats(1e-4, 50))
def test_a_steady_machine_is_not_tried_again_and_again(cost: float) -> None:
    late = settled(cost)[-30:]
    assert len(set(late)) == 1


def test_a_slow_picture_makes_the_next_one_coarser_and_the_floor_holds() -> None:
    pace = Pace()
    pace.seen(8, 0.08)
    assert pace.divisor == 16
    for _ in range(5):
        pace.seen(pace.divisor, 10.0)
    assert pace.divisor == 24


def test_one_lucky_picture_is_not_enough() -> None:
    pace = Pace()
    for seconds in (0.001, 0.001, 0.03, 0.001, 0.001):
        pace.seen(8, seconds)
    assert pace.divisor == 8
    pace.seen(8, 0.001)
    assert pace.divisor == 6


def test_pictures_begun_at_another_size_say_nothing() -> None:
    pace = Pace()
    pace.seen(4, 10.0)
    assert pace.divisor == 8


@pytest.mark.parametrize("divisor", [24, 8, 4, 3, 2, 1])
def test_stages_climb_to_the_whole_and_once_more_with_all_samples(divisor: int) -> None:
    stages = Pace(divisor=divisor).stages
    assert stages[0] == divisor
    assert stages[-2:] == (1, 1)
    assert all(before > after for before, after in pairwise(stages[:-1]))
