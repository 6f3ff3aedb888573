"""How fast this machine is at the moment, so that waits in tests follow it."""

import time

_UNIT = 0.02
"""s that :func:`_work` takes on one idle core of a server of 2022"""


def slowness() -> float:
    """How many times slower than usual work is done just now, and at least 1; measured anew at every call."""
    began = time.perf_counter()
    _work()
    return max(1.0, (time.perf_counter() - began) / _UNIT)


class Patience:
    """A wait of so many seconds on a usual machine, and as much longer as this one is slower."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._began = time.monotonic()
        self._end = self._began + seconds

    def is_over(self) -> bool:
        """Whether it has been waited for long enough; the machine is measured only when that seems so."""
        if time.monotonic() < self._end:
            return False
        self._end = self._began + self._seconds * slowness()
        return time.monotonic() >= self._end


def _work() -> int:
    """Plain arithmetic, on one core."""
    total = 0
    for number in range(400_000):
        total += number * number
    return total
