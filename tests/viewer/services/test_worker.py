import os
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from tests.viewer.machine import Patience, slowness
from viewer.services.worker import Job, Worker


def wait(worker: Worker, until: Callable[[], bool], longest: float = 5.0) -> None:
    patience = Patience(longest)
    while not until():
        worker.deliver()
        assert not patience.is_over(), "waited in vain"
        time.sleep(0.001)


def ticking(closed: list[str] | None = None, name: str = "", pause: float = 0.001) -> Iterator[int]:
    try:
        number = 0
        while True:
            time.sleep(pause)
            yield number
            number += 1
    finally:
        if closed is not None:
            closed.append(name)


def test_values_come_in_order_on_this_thread_and_then_the_end(worker: Worker) -> None:
    seen: list[object] = []

    def value(number: int) -> None:
        assert threading.current_thread() is threading.main_thread()
        seen.append(number)

    worker.submit(Job("count", lambda: iter([1, None, 2, 3]), value, lambda error: seen.append(error)))
    wait(worker, lambda: not worker.busy())
    assert seen == [1, 2, 3, None]


def test_an_exception_is_a_value_and_the_worker_goes_on(worker: Worker) -> None:
    def failing() -> Iterator[int]:
        yield 1
        raise MemoryError("none left")

    seen: list[object] = []
    worker.submit(Job("bad", failing, seen.append, seen.append))
    worker.submit(Job("bad start", lambda: 1 / 0, seen.append, seen.append))  # type: ignore[arg-type, return-value]
    wait(worker, lambda: not worker.busy())
    assert sorted(type(value).__name__ for value in seen) == ["MemoryError", "ZeroDivisionError", "int"]
    worker.submit(Job("good", lambda: iter(["fine"]), seen.append))
    wait(worker, lambda: "fine" in seen)


def test_a_newer_job_takes_the_place_of_an_older_one(worker: Worker) -> None:
    seen: list[tuple[str, int]] = []
    closed: list[str] = []
    worker.submit(Job("same", lambda: ticking(closed, "old"), lambda value: seen.append(("old", value))))
    wait(worker, lambda: len(seen) > 3)
    worker.submit(Job("same", lambda: iter([7]), lambda value: seen.append(("new", value))))
    wait(worker, lambda: not worker.busy())
    assert seen[-1] == ("new", 7)
    wait(worker, lambda: closed == ["old"])


def test_a_stream_of_newer_renders_does_not_keep_every_frame_from_being_shown(worker: Worker) -> None:
    def render(number: int) -> Iterator[int | None]:
        for _ in range(5):
            time.sleep(0.004)
            yield None
        yield number
        yield from ticking()

    seen: list[int] = []
    patience, number = Patience(5.0), 0
    while len(seen) <= 10:  # a drag that never rests, a new job every 2 ms
        assert not patience.is_over(), "few renders are shown"
        worker.submit(Job("view", lambda number=number: render(number), seen.append, urgent=True))
        number += 1
        time.sleep(0.002)
        worker.deliver()
    wait(worker, lambda: number - 1 in seen)
    first = [value for value in seen if value > 1]
    assert first == sorted(first)


def test_a_render_at_rest_does_not_keep_a_drag_waiting(worker: Worker) -> None:
    seen: list[str] = []
    stepped, over = threading.Event(), threading.Event()

    def endless() -> Iterator[str | None]:
        while not over.is_set():
            stepped.set()
            yield None
        yield "whole"

    worker.submit(Job("view", endless, seen.append))
    assert stepped.wait(60)
    worker.submit(Job("view", lambda: iter(["coarse"]), seen.append, urgent=True))
    wait(worker, lambda: seen == ["coarse"])
    over.set()
    wait(worker, lambda: not worker.busy())
    assert seen == ["coarse"]


def test_the_last_step_of_what_was_replaced_lets_no_two_renders_run_beside_each_other(worker: Worker) -> None:
    seen: list[tuple[int, str]] = []
    stepping, go_on = threading.Event(), threading.Event()

    def sharpened() -> Iterator[tuple[int, str]]:
        stepping.set()
        go_on.wait(60)
        yield 0, "whole"

    worker.submit(Job("view", sharpened, seen.append))
    assert stepping.wait(60)
    for number in (1, 2):  # both come during that step
        stages = [(number, "coarse"), (number, "fine")]
        worker.submit(Job("view", lambda stages=stages: iter(stages), seen.append, urgent=True))
    go_on.set()
    wait(worker, lambda: not worker.busy())
    assert seen == [(1, "coarse"), (2, "coarse"), (2, "fine")]


def test_an_urgent_job_goes_between_the_steps_of_another(worker: Worker) -> None:
    steps: list[int] = []
    worker.submit(Job("fit", lambda: ticking(pause=0.05), steps.append))
    wait(worker, lambda: bool(steps))
    for _ in range(3):
        seen: list[int] = []
        began = time.monotonic()
        worker.submit(Job("view", lambda: iter([1]), seen.append, urgent=True))
        wait(worker, lambda: bool(seen))  # noqa: B023
        assert time.monotonic() - began < 0.5 * slowness()
    assert worker.busy("fit")


def test_time_is_shared_fairly_between_long_and_short_steps(worker: Worker) -> None:
    long: list[int] = []
    short: list[int] = []
    worker.submit(Job("long", lambda: ticking(pause=0.1), long.append))
    worker.submit(Job("short", lambda: ticking(pause=0.01), short.append))
    wait(worker, lambda: len(long) >= 8)
    assert len(short) > 3 * len(long)


def test_nothing_of_a_cancelled_job_is_delivered(worker: Worker) -> None:
    seen: list[object] = []
    closed: list[str] = []
    worker.submit(Job("fit", lambda: ticking(closed, "fit"), seen.append, seen.append))
    time.sleep(0.1)
    worker.cancel("fit")
    worker.cancel("never heard of")
    wait(worker, lambda: closed == ["fit"])
    worker.deliver()
    assert seen == []
    assert not worker.busy()


def test_closing_ends_at_once_and_cleans_up() -> None:
    worker, closed, seen = Worker(), list[str](), list[int]()
    for name in ("fit", "export"):
        worker.submit(Job(name, lambda name=name: ticking(closed, name, 0.02), seen.append))
    wait(worker, lambda: len(seen) > 4)
    began = time.monotonic()
    worker.close()
    worker.close()
    assert time.monotonic() - began < 1.0 * slowness()
    assert sorted(closed) == ["export", "fit"]


def test_the_window_is_woken_for_every_delivery() -> None:
    woken = threading.Event()
    worker = Worker(woken.set)
    worker.submit(Job("one", lambda: iter([1]), lambda value: None))
    assert woken.wait(60.0)
    worker.close()


def test_it_rests_once_after_each_spell_of_work() -> None:
    rested: list[int] = []
    worker = Worker(at_rest=lambda: rested.append(len(rested)))
    for turn in range(2):
        worker.submit(Job("one", lambda: iter([1]), lambda value: None))
        wait(worker, lambda turn=turn: len(rested) > turn)
    worker.close()
    assert rested == [0, 1]


@pytest.mark.skipif(sys.platform != "linux", reason="threads have a priority of their own on Linux only")
def test_the_worker_steps_back_behind_the_window(worker: Worker) -> None:
    seen: list[int] = []
    nice = lambda: iter([os.getpriority(os.PRIO_PROCESS, threading.get_native_id())])  # noqa: E731
    worker.submit(Job("nice", nice, seen.append))
    wait(worker, lambda: bool(seen))
    assert seen[0] >= min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)
