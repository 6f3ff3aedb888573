"""A thread that does slow work in small steps, so that the window never waits."""

import logging
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from core.runtime.modes import TorchModes

T = TypeVar("T")

_REST = 1.0  # s without work until ``at_rest``: memory that is returned earlier would soon be needed again


@dataclass(frozen=True, eq=False)
class Job(Generic[T]):
    """A stream that the worker steps. Its callbacks run in :meth:`Worker.deliver`, on the window's thread."""

    name: str  # a newer job replaces an older one of the same name
    start: Callable[[], Iterable[T | None]]  # makes the stream, on the worker's thread; None values only end a step
    value: Callable[[T], None]  # called with every other value
    end: Callable[[Exception | None], None] = lambda error: None  # called once with the error, unless cancelled
    urgent: bool = False
    """Runs before all other jobs until its first value, also in the pauses of their steps
    (:func:`core.runtime.pool.pause`); a newer job of its name waits for that."""
    weight: float = 1.0  # of the worker's time, relative to other jobs


@dataclass(eq=False)
class _Running:
    job: Job
    spent: float  # worker's time, s, divided by the job's weight; the least is stepped next
    stream: Iterator | None = None  # None until the first step
    posted: bool = False  # a callback was posted
    over: bool = False  # not to be stepped again
    muted: bool = False  # pending callbacks are dropped


class Worker:
    """Steps jobs in turn. A cancelled job is not stepped again, so cancelling never waits."""

    def __init__(
        self,
        wake: Callable[[], None] = lambda: None,
        at_rest: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Start the thread, which makes all these calls.

        Args:
            wake: called when callbacks are pending.
            at_rest: called after a second without work.
            clock: time in s, read before and after every step.
        """
        self.wake = wake
        self._at_rest = at_rest
        self._clock = clock
        self._rests = False
        self._paused = 0.0  # s that steps were paused for urgent jobs
        self._running: list[_Running] = []
        self._next: dict[str, Job] = {}
        self._delivery: deque[tuple[_Running, Callable[[], None]]] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="worker")
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Start a job in place of an older one of its name; after the first value of an urgent one."""
        with self._changed:
            current = next((entry for entry in self._running if entry.job.name == job.name and not entry.over), None)
            if current and current.job.urgent and not current.posted:
                self._next[job.name] = job
            else:
                self._begin(job, current)
            self._changed.notify()

    def cancel(self, name: str) -> None:
        """Stop the job of this name and drop its pending callbacks."""
        with self._changed:
            self._next.pop(name, None)
            for entry in (*self._running, *(entry for entry, _ in self._delivery)):
                if entry.job.name == name:
                    entry.over = entry.muted = True
            self._changed.notify()

    def busy(self, *names: str) -> bool:
        """True if a job, of these names if given, is running or has callbacks pending."""
        with self._changed:
            pending = [entry for entry, _ in self._delivery if not entry.muted]
            alive = [entry for entry in self._running if not entry.over]
            return any(not names or entry.job.name in names for entry in pending + alive)

    def deliver(self) -> None:
        """Call the pending callbacks. Call once a frame, on the window's thread."""
        for _ in range(len(self._delivery)):
            entry, callback = self._delivery.popleft()
            if not entry.muted:
                callback()

    def stop(self) -> None:
        """Let the thread end after its current step; streams are closed, so that they clean up."""
        with self._changed:
            self._closing = True
            self._changed.notify()

    def close(self) -> None:
        """Stop the thread and wait for it."""
        self.stop()
        self._thread.join()
        self._delivery.clear()

    def _begin(self, job: Job, old: _Running | None) -> None:
        if old:  # an urgent job's pending frame is still worth seeing; other results would mislead
            old.over = True
            old.muted = not old.job.urgent
        smallest = min((entry.spent for entry in self._running if not entry.over), default=0.0)
        self._running.append(_Running(job, smallest))

    def _run(self) -> None:
        if sys.platform == "linux":  # the window keeps its frame rate beside torch on few cores
            os.nice(2)  # affects this thread alone
        while (entry := self._pick()) is not None:
            began = self._clock() - self._paused
            self._step_in_modes(entry)
            entry.spent += (self._clock() - self._paused - began) / entry.job.weight
        for left in self._running:
            _close(left.stream)

    def _pick(self) -> _Running | None:
        """Wait for work and return the job to step next; None when closing.

        An urgent job without a value comes first, then the job with the least time by its weight.
        """
        while not self._closing:
            with self._changed:
                ended = [entry for entry in self._running if entry.over]
                self._running = [entry for entry in self._running if not entry.over]
                quiet = not (self._running or ended or self._closing)
                if quiet:
                    quiet = not self._changed.wait(None if self._rests else _REST)
                order = sorted(self._running, key=lambda entry: (entry.posted or not entry.job.urgent, entry.spent))
            for entry in ended:
                _close(entry.stream)
            if order:
                self._rests = False
                return order[0]
            if quiet and not self._rests:
                self._rests = True
                self._at_rest()
        return None

    def _step_in_modes(self, entry: _Running) -> None:
        """Step a job; modes of torch that it leaves on between steps are logged, and do not reach the next job."""
        from core.runtime.modes import TorchModes  # imported late: the splash appears before torch is loaded
        from core.runtime.pool import at_pause

        modes = TorchModes.current()
        waits = entry.job.urgent and not entry.posted
        at_pause(None if waits else partial(self._step_urgent, modes))
        with modes.applied():
            self._step(entry)
            left_on = TorchModes.current()
        if left_on != modes:
            logging.getLogger(__name__).error("the job %s is faulty: it left on %s", entry.job.name, left_on)

    def _step_urgent(self, modes: "TorchModes") -> None:
        """Step urgent jobs to their first values, in a pause of another job's step, which is not charged for them."""
        from core.runtime.pool import at_pause

        if self._urgent() is None:
            return
        at_pause(None)  # their own steps are not paused
        with modes.applied():
            while (entry := self._urgent()) is not None:
                began = self._clock()
                self._step(entry)
                seconds = self._clock() - began
                entry.spent += seconds / entry.job.weight
                self._paused += seconds
        at_pause(partial(self._step_urgent, modes))

    def _urgent(self) -> _Running | None:
        """Return an urgent job without a value, if there is one."""
        with self._changed:
            waiting = (entry for entry in self._running if entry.job.urgent and not (entry.posted or entry.over))
            return None if self._closing else next(waiting, None)

    def _step(self, entry: _Running) -> None:
        try:
            if entry.stream is None:
                entry.stream = iter(entry.job.start())
            value = next(entry.stream)
        except StopIteration:
            self._post(entry, lambda: entry.job.end(None), over=True)
        except Exception as error:  # the window shows any error of a job
            self._post(entry, partial(entry.job.end, error), over=True)
        else:
            if value is not None:
                self._post(entry, lambda: entry.job.value(value))

    def _post(self, entry: _Running, callback: Callable[[], None], over: bool = False) -> None:
        with self._changed:
            self._delivery.append((entry, callback))
            replaced = entry.over
            entry.posted = True
            entry.over = entry.over or over
            if not replaced and (newer := self._next.pop(entry.job.name, None)):  # else it waits for its predecessor
                self._begin(newer, entry)
        self.wake()


def _close(stream: Iterator | None) -> None:
    if isinstance(stream, Generator):
        with suppress(Exception):  # nobody waits for errors of an abandoned job
            stream.close()
