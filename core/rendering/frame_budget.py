"""The frame budget: how coarse the first frame must be to keep up with the input on this machine."""

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)
"""What the image size is divided by for the first frame."""
_HEADROOM = 0.7
"""share of the budget: a first frame faster than this allows a finer one"""
_MIN_HEIGHT = 64
"""px of a first frame: a smaller one hardly takes less time, and shows nothing"""
_MAX_DROP = 2
"""levels at a time, at most: one disturbance must not spoil the image"""
_PATIENCE, _MAX_PATIENCE = 3, 96
"""Frames in a row with headroom before a finer one is tried; twice as many each time that it was too slow, unless it
would fit even if all of the time grew with the size: so the image is fine again soon after other work has ended."""


class FrameBudget:
    """Chooses the size of the first frame from what earlier ones took: at once coarser, or a level finer after a while.

    Nothing is assumed of how cost grows with size: a finer first frame is tried, ever more seldom if it fails. None is
    lower than 64 px, if the image is not.
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

    def divisors(self, height: int) -> tuple[int, ...]:
        """Divisors of the size of an image so many px high: the first frame's, then 1/4, 1/2 and full size, and full
        size once more.
        """
        while self.divisor > 1 and height < _MIN_HEIGHT * self.divisor:
            self._level += 1
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
            if self._level + 1 < len(_DIVISORS) and self._headroom >= self._patience_for(seconds):
                self._level, self._headroom, self._refined = self._level + 1, 0, True

    def _patience_for(self, seconds: float) -> int:
        """Frames with headroom before a finer one is tried, where the last one took so long."""
        finer = seconds * (self.divisor / _DIVISORS[self._level + 1]) ** 2
        return _PATIENCE if finer <= _HEADROOM * self.budget else self._patience

    def _coarsen(self, seconds: float) -> None:
        if self._refined:
            self._patience = min(2 * self._patience, _MAX_PATIENCE)
        before = self.divisor
        for _ in range(_MAX_DROP):
            if self._level and seconds * (before / self.divisor) ** 2 > self.budget:
                self._level -= 1
        self._headroom, self._refined = 0, False
