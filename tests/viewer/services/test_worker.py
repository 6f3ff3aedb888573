import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing
from functools import partial
from itertools import count

import pytest
import torch

from core.runtime.modes import TorchModes
from core.runtime.pool import pause
from tests.viewer.machine import Patience
from tests.viewer.stand_ins import Clock
from viewer.services.worker import Job, Worker


def wait(worker: Worker, until: Callable[[], bool], longest: float = 60.0) -> None:
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
    values: list[object] = []

    def value(number: int) -> None:
        assert threading.current_thread() is threading.main_thread()
        values.append(number)

    worker.submit(Job("count", lambda: iter([1, None, 2, 3]), value, lambda error: values.append(error)))
    wait(worker, lambda: not worker.busy())
    assert values == [1, 2, 3, None]


def test_an_exception_is_a_value_and_the_worker_goes_on(worker: Worker) -> None:
    def failing() -> Iterator[int]:
        yield 1
        raise MemoryError("none left")

    values: list[object] = []
    worker.submit(Job("bad", failing, values.append, values.append))
    worker.submit(Job("bad start", lambda: 1 / 0, values.append, values.append))  # type: ignore[arg-type, return-value]
    wait(worker, lambda: not worker.busy())
    assert sorted(type(value).__name__ for value in values) == ["MemoryError", "ZeroDivisionError", "int"]
    worker.submit(Job("good", lambda: iter(["fine"]), values.append))
    wait(worker, lambda: "fine" in values)


def test_a_newer_job_takes_the_place_of_an_older_one(worker: Worker) -> None:
    values: list[tuple[str, int]] = []
    closed: list[str] = []
    worker.submit(Job("same", lambda: ticking(closed, "old"), lambda value: values.append(("old", value))))
    wait(worker, lambda: len(values) > 3)
    worker.submit(Job("same", lambda: iter([7]), lambda value: values.append(("new", value))))
    wait(worker, lambda: not worker.busy())
    assert values[-1] == ("new", 7)
    wait(worker, lambda: closed == ["old"])


def test_a_stream_of_newer_renders_does_not_keep_every_frame_from_being_shown(worker: Worker) -> None:
    def render(number: int) -> Iterator[int | None]:
        for _ in range(5):
            time.sleep(0.004)
            yield None
        yield number
        for _ in ticking():
            yield None

    numbers: list[int] = []
    patience = Patience(60.0)
    number = 0
    while len(numbers) <= 10:  # a drag that never rests, a new job every 2 ms
        assert not patience.is_over(), "few renders are shown"
        worker.submit(Job("view", lambda number=number: render(number), numbers.append, urgent=True))
        number += 1
        time.sleep(0.002)
        worker.deliver()
    wait(worker, lambda: number - 1 in numbers)
    assert numbers == sorted(numbers)


def test_a_replaced_render_ends_before_the_next_begins(worker: Worker) -> None:
    values: list[tuple[int, str]] = []
    stepping = threading.Event()
    go_on = threading.Event()

    def sharpened() -> Iterator[tuple[int, str]]:
        stepping.set()
        go_on.wait(60)
        yield 0, "whole"

    worker.submit(Job("view", sharpened, values.append))
    assert stepping.wait(60)
    for number in (1, 2):  # both come during that step
        stages = [(number, "coarse"), (number, "fine")]
        worker.submit(Job("view", lambda stages=stages: iter(stages), values.append, urgent=True))
    go_on.set()
    wait(worker, lambda: not worker.busy())
    assert values == [(1, "coarse"), (2, "coarse"), (2, "fine")]


def test_an_urgent_job_goes_between_the_steps_of_another(worker: Worker) -> None:
    begun: list[int] = []

    def fit() -> Iterator[int]:
        for number in count():
            begun.append(number)
            time.sleep(0.05)
            yield number

    worker.submit(Job("fit", fit, lambda number: None))
    wait(worker, lambda: bool(begun))
    for _ in range(3):
        steps: list[int] = []
        worker.submit(Job("view", lambda: iter([len(begun)]), steps.append, urgent=True))
        limit = len(begun) + 1  # one may have been chosen already
        wait(worker, lambda: bool(steps))  # noqa: B023
        assert steps[0] <= limit
    assert worker.busy("fit")


def test_an_urgent_job_runs_in_a_pause_of_another_step(worker: Worker) -> None:
    """The other step goes on in its own modes, and the urgent one has the worker's."""
    entered = threading.Event()
    values: list[object] = []

    def long_step() -> Iterator[bool]:
        with torch.inference_mode():
            entered.set()
            patience = Patience(60.0)
            while "urgent" not in begun and not patience.is_over():
                pause()
            mode = torch.is_inference_mode_enabled()
        yield mode

    begun: list[str] = []

    def urgent() -> Iterator[bool]:
        begun.append("urgent")
        pause()  # not paused itself
        yield torch.is_inference_mode_enabled()

    worker.submit(Job("long", long_step, lambda mode: values.append(("long", mode))))
    assert entered.wait(60.0)
    worker.submit(Job("view", urgent, lambda mode: values.append(("view", mode)), urgent=True))
    wait(worker, lambda: len(values) == 2)
    assert values == [("view", False), ("long", True)]


def test_time_is_shared_fairly_between_long_and_short_steps(clock: Clock) -> None:
    long: list[float] = []
    short: list[float] = []
    both = threading.Event()

    def steps(seconds: float) -> Iterator[float]:
        both.wait(60)
        while True:
            clock.now += seconds
            yield seconds

    with closing(Worker(clock=clock)) as worker:
        worker.submit(Job("long", lambda: steps(0.1), long.append))
        worker.submit(Job("short", lambda: steps(0.01), short.append))
        both.set()
        wait(worker, lambda: len(long) >= 8)
    assert len(short) > 3 * len(long)


def test_callbacks_of_a_cancelled_job_are_dropped(worker: Worker) -> None:
    values: list[object] = []
    closed: list[str] = []
    made = threading.Event()
    worker.wake = made.set
    worker.submit(Job("fit", lambda: ticking(closed, "fit"), values.append, values.append))
    assert made.wait(60)
    worker.cancel("fit")
    worker.cancel("never heard of")
    wait(worker, lambda: closed == ["fit"])
    worker.deliver()
    assert values == []
    assert not worker.busy()


def test_closing_ends_jobs_and_closes_their_streams() -> None:
    worker = Worker()
    closed = list[str]()
    names = set[str]()
    for name in ("fit", "export"):
        worker.submit(Job(name, lambda name=name: ticking(closed, name, 0.02), lambda _, name=name: names.add(name)))
    wait(worker, lambda: len(names) == 2)
    worker.close()
    worker.close()
    assert sorted(closed) == ["export", "fit"]


def test_deliveries_wake_the_window_and_work_ends_with_a_rest() -> None:
    woken = threading.Event()
    worker = Worker(woken.set)
    worker.submit(Job("one", lambda: iter([1]), lambda value: None))
    assert woken.wait(60.0)
    worker.close()
    rested: list[int] = []
    worker = Worker(at_rest=lambda: rested.append(len(rested)))
    for turn in range(2):
        worker.submit(Job("one", lambda: iter([1]), lambda value: None))
        wait(worker, lambda turn=turn: len(rested) > turn)
    worker.close()
    assert rested == [0, 1]


@pytest.mark.skipif(sys.platform != "linux", reason="threads have a priority of their own on Linux only")
def test_the_worker_has_a_lower_priority_than_the_window(worker: Worker) -> None:
    priorities: list[int] = []
    nice = lambda: iter([os.getpriority(os.PRIO_PROCESS, threading.get_native_id())])  # noqa: E731
    worker.submit(Job("nice", nice, priorities.append))
    wait(worker, lambda: bool(priorities))
    assert priorities[0] >= min(19, os.getpriority(os.PRIO_PROCESS, 0) + 2)


@pytest.mark.parametrize(
    "left_on", [torch.inference_mode, torch.no_grad, partial(torch.autocast, "cpu", torch.bfloat16)]
)
def test_a_mode_that_a_job_leaves_on_does_not_reach_the_next_one(
    worker: Worker, caplog: pytest.LogCaptureFixture, left_on: Callable[[], AbstractContextManager[None]]
) -> None:
    def leaking() -> Iterator[int]:
        with left_on():
            yield 1
            goes_on.wait(60)
            yield 2
        yield 3

    def differentiating() -> Iterator[tuple[float, torch.dtype]]:
        for _ in range(9):
            weight = torch.ones(2, 2, requires_grad=True)
            value = (weight @ weight).sum()
            value.backward()
            yield float(weight.grad.sum()), (weight @ weight).dtype

    goes_on = threading.Event()
    values = list[object]()
    ends = list[Exception | None]()
    worker.submit(Job("leaking", leaking, values.append, ends.append))
    wait(worker, lambda: values == [1])
    goes_on.set()
    worker.submit(Job("next", differentiating, values.append, ends.append))
    wait(worker, lambda: not worker.busy())
    assert ends == [None, None]
    assert sorted(value for value in values if isinstance(value, int)) == [1, 2, 3], "the job itself goes on"
    assert {value for value in values if not isinstance(value, int)} == {(16.0, torch.float32)}
    assert {record.name for record in caplog.records} == {"viewer.services.worker"}
    assert "the job leaking is faulty" in caplog.records[0].message
    worker.submit(Job("after", lambda: iter([TorchModes.current()]), values.append))
    wait(worker, lambda: not worker.busy())
    assert values[-1] == TorchModes.current()
