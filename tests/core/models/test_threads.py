"""Threads by measurement: several where they help, one where they wait for each other."""

from collections.abc import Iterator

import pytest
import torch

from core.models import threads
from core.models.threads import Threads, with_measured_threads


@pytest.fixture(autouse=True)
def same_threads_afterwards() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize(("several", "chosen"), [(0.5, 2), (0.8, 2), (0.95, 1), (1.0, 1), (9.0, 1)])
def test_several_threads_must_be_clearly_faster(several: float, chosen: int):
    torch.set_num_threads(2)
    Threads(lambda count: several if count > 1 else 1.0).look()
    assert torch.get_num_threads() == chosen


@pytest.mark.parametrize("slow", [0, 4, 7])
def test_a_single_slow_round_tells_of_a_busy_machine_and_ends_the_measurement(slow: int):
    taken: list[int] = []

    def measure(count: int) -> float:
        taken.append(count)
        return 1.0 if count == 1 else 5.0 if len(taken) == 2 * slow + 2 else 0.1

    torch.set_num_threads(2)
    Threads(measure).look()
    assert torch.get_num_threads() == 1
    assert len(taken) == 2 * slow + 2


def test_where_there_is_one_thread_nothing_is_measured():
    def never(count: int) -> float:
        raise AssertionError

    torch.set_num_threads(1)
    Threads(never).look()
    assert torch.get_num_threads() == 1


def test_it_is_measured_again_after_a_while(monkeypatch: pytest.MonkeyPatch):
    taken: list[int] = []

    def measure(count: int) -> float:
        taken.append(count)
        return (1.0 if count == 1 else 2.0) if busy else 1 / count

    busy, now = False, 100.0
    monkeypatch.setattr(threads.time, "monotonic", lambda: now)
    torch.set_num_threads(2)
    some = Threads(measure)
    some.look()
    asked, busy = len(taken), True
    some.look()
    assert (len(taken), torch.get_num_threads()) == (asked, 2)
    now += 60
    some.look()
    assert len(taken) > asked
    assert torch.get_num_threads() == 1
    now, busy = now + 60, False
    some.look()
    assert torch.get_num_threads() == 2


def test_while_one_thread_is_faster_it_is_measured_ever_more_seldom(monkeypatch: pytest.MonkeyPatch):
    taken: list[float] = []

    def measure(count: int) -> float:
        taken.append(now)
        return 1.0 * count

    now = 0.0
    monkeypatch.setattr(threads.time, "monotonic", lambda: now)
    torch.set_num_threads(2)
    some = Threads(measure)
    for _ in range(60):
        some.look()
        now += 1
    assert sorted(set(taken)) == [0, 4, 12, 28, 44]


def test_whoever_sets_another_number_says_how_many_there_may_be():
    torch.set_num_threads(3)
    some = Threads(lambda count: 1 / count)
    some.look()
    assert torch.get_num_threads() == 3
    torch.set_num_threads(2)
    some.look()
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize("busy", [True, False])
def test_a_core_is_left_to_another_however_busy_the_machine_was(busy: bool):
    now_busy = busy
    torch.set_num_threads(4)
    some = Threads(lambda count: 1.0 * count if now_busy else 1 / count)
    some.look()
    assert torch.get_num_threads() == (1 if busy else 4)
    some.leave_one()
    now_busy = False
    some.look()
    assert torch.get_num_threads() == 3


def test_of_two_cores_one_is_left():
    torch.set_num_threads(2)
    some = Threads(lambda count: 1 / count)
    some.leave_one()
    some.look()
    assert torch.get_num_threads() == 1


def test_a_stream_gives_its_values_and_leaves_the_threads_as_they_were():
    torch.set_num_threads(2)
    assert list(with_measured_threads(iter("abc"))) == ["a", "b", "c"]
    assert torch.get_num_threads() == 2


def test_what_is_really_measured_takes_time():
    torch.set_num_threads(2)
    Threads().look()
    assert torch.get_num_threads() in (1, 2)
