from itertools import pairwise

import pytest

from viewer.quality import QUALITIES, Speed


@pytest.mark.parametrize(("rate", "first"), [(1e2, 16), (3e4, 8), (1e5, 4), (1e9, 4)])
def test_the_first_picture_comes_in_time_and_the_last_is_whole(rate: float, first: int) -> None:
    stages = Speed(rate).stages(256 * 256)
    assert stages[0] == first
    assert stages[-1] == 1
    assert all(before == 2 * after for before, after in pairwise(stages))
    assert first == 16 or 256 * 256 / first**2 / rate < 0.05


def test_the_rate_follows_what_is_seen() -> None:
    speed = Speed(100.0)
    for _ in range(20):
        speed.seen(1000, 0.01)
    assert speed.rate == pytest.approx(1e5, rel=1e-3)
    speed.seen(1000, 0.0)  # a clock that has not moved
    assert speed.rate < float("inf")


def test_finer_is_more_work_every_time() -> None:
    work = [quality.detail**2 * quality.samples for quality in QUALITIES]
    assert all(1.3 < after / before < 4 for before, after in pairwise(work))
