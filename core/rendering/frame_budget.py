"""The frame budget: how coarse the first frame must be to keep up with the input on this machine."""

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)
"""What the image size is divided by for the first frame."""
_HEADROOM = 0.7
"""share of the budget: a first frame faster than this allows a finer one"""
_MAX_DROP = 2
"""levels at a time, at most: one disturbance must not spoil the image"""
_PATIENCE, _MAX_PATIENCE = 3, 96
"""frames in a row with headroom before a finer one is tried; twice as many each time that it was too slow"""


class FrameBudget:
    """Chooses the size of the first frame from what earlier ones took: at once coarser, or a level finer after a while.

    Nothing is assumed of how cost grows with size: a finer first frame is tried, ever more seldom if it fails.
    """

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget
        """s for the first frame while something moves"""
        self._level = _DIVISORS.index(divisor)
        self._headroom, self._patience, self._refined = 0, _PATIENCE, False

    @property
    def divisor(self) -> int:
        """What the image size is divided by for the next first frame."""
        return _DIVISORS[self._level]

    @property
    def divisors(self) -> tuple[int, ...]:
        """Divisors of the image size: the first frame's, then 1/4, 1/2 and full size, and full size once more."""
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def observe(self, divisor: int, seconds: float) -> None:
        """Learn from the time that a first frame with this divisor took."""
        if divisor != self.divisor:
            return
        if seconds > self.budget:
            self._coarsen(seconds)
        elif seconds > _HEADROOM * self.budget:
            self._headroom = 0
        else:
            self._headroom += 1
            if self._headroom >= self._patience and self._level + 1 < len(_DIVISORS):
                self._level, self._headroom, self._refined = self._level + 1, 0, True

    def _coarsen(self, seconds: float) -> None:
        if self._refined:
            self._patience = min(2 * self._patience, _MAX_PATIENCE)
        before = self.divisor
        for _ in range(_MAX_DROP):
            if self._level and seconds * (before / self.divisor) ** 2 > self.budget:
                self._level -= 1
        self._headroom, self._refined = 0, False
