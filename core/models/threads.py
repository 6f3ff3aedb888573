"""How many threads torch works with: measured on this machine as it is now, never assumed.

A field's operations are small, and at the end of each all threads wait for the slowest. Beside another busy process
that is the one whose core is taken, so that two threads are several times slower than one. Most operations are over
before a core is taken, so a typical one tells nothing: it is the slowest of a few that does.
"""

import time
from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

import torch

from core.models.precision import matmul_dtype

T = TypeVar("T")

_INTERVAL, _LONGEST = 2.0, 16.0
"""s of work between two measurements. Twice as many each time that one thread was faster: beside busy processes a
measurement costs a tenth of a second, and what it could gain is little."""
_ROUNDS = 12
_GAIN = 0.85
"""Share of one thread's time that several must get by with, as a rule; and none of the time may they take longer."""
_ROWS, _WIDTH, _LAYERS = 2048, 128, 4
"""of the operations that are timed: as small as those of a fit's first stages"""


class Threads:
    """Chooses between one thread and as many as torch is set to, again and again while something runs.

    Whoever sets torch to another number in between says how many there may be from then on.

    Args:
        measure: seconds that a few operations take with so many threads.
    """

    def __init__(self, measure: Callable[[int], float] | None = None) -> None:
        self._measure = measure or _seconds
        self._most, self._chosen, self._due, self._wait = 1, 0, -1.0, _INTERVAL
        self._spared = 0

    def leave_one(self) -> None:
        """From now on one core is another's: beside a window that the processor draws, one thread more would wait."""
        self._spared, self._due = 1, -1.0

    def look(self) -> None:
        """Measure, if the last time is a while ago, and let torch use what was faster in this thread of the program."""
        if torch.get_num_threads() != self._chosen:
            self._most, self._due = torch.get_num_threads(), -1.0
        if self._most > 1 and time.monotonic() >= self._due:
            several = self._several > 1 and self._several_are_faster()
            torch.set_num_threads(self._several if several else 1)
            self._wait = _INTERVAL if several else min(2 * self._wait, _LONGEST)
            self._due = time.monotonic() + self._wait
        self._chosen = torch.get_num_threads()

    @property
    def _several(self) -> int:
        return self._most - self._spared

    def _several_are_faster(self) -> bool:
        """Ends with the first round that says no."""
        rounds = []
        for _ in range(_ROUNDS):
            # Turn about, so that what else the machine does falls on both.
            rounds.append((self._measure(1), self._measure(self._several)))
            if rounds[-1][1] > rounds[-1][0]:
                return False
        one, several = (sorted(column)[_ROUNDS // 2] for column in zip(*rounds, strict=True))
        return several < _GAIN * one


def _seconds(threads: int) -> float:
    torch.set_num_threads(threads)
    values = torch.ones(_ROWS, _WIDTH, dtype=matmul_dtype("cpu"))
    weight = torch.ones(_WIDTH, _WIDTH, dtype=values.dtype)
    with torch.no_grad():
        began = time.perf_counter()
        for _ in range(_LAYERS):
            torch.nn.functional.linear(values, weight).relu_()
    return time.perf_counter() - began


def with_measured_threads(stream: Iterable[T]) -> Generator[T, None, None]:
    """The values of a stream, each made with as many threads as were faster lately; as many as before at its end."""
    before, threads, values = torch.get_num_threads(), Threads(), iter(stream)
    try:
        threads.look()
        for value in values:
            yield value
            threads.look()
    finally:
        torch.set_num_threads(before)
