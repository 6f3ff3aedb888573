"""The frame budget: how coarse a picture must begin so that it follows the hand on this machine."""

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)
"""What the size of the first picture is divided by; the coarsest is the floor."""
_ROOMY = 0.7
"""of the budget: what leaves room for a finer beginning"""
_DROP = 2
"""rungs at a time, at most: one disturbance must not throw the picture away"""
_PATIENCE, _LONGEST = 3, 96
"""frames in a row with room to spare before a finer beginning is tried; twice as many each time that it was too slow"""


class Pace:
    """Learns from first pictures what they take. Too slow: at once coarser. Room to spare for a while: a rung finer.

    Nothing is assumed of how cost grows with size: a finer beginning is tried, ever more seldom if it fails.
    """

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget
        """s for the first picture while something moves"""
        self._rung = _DIVISORS.index(divisor)
        self._roomy, self._patience, self._climbed = 0, _PATIENCE, False

    @property
    def divisor(self) -> int:
        """What the size of the next first picture is divided by."""
        return _DIVISORS[self._rung]

    @property
    def stages(self) -> tuple[int, ...]:
        """Divisors of a picture's size: from the first picture over 1/4, 1/2 and the whole to the whole once more."""
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def seen(self, divisor: int, seconds: float) -> None:
        """Take in what a first picture took, which began at this divisor."""
        if divisor != self.divisor:
            return
        if seconds > self.budget:
            self._fall(seconds)
        elif seconds > _ROOMY * self.budget:
            self._roomy = 0
        else:
            self._roomy += 1
            if self._roomy >= self._patience and self._rung + 1 < len(_DIVISORS):
                self._rung, self._roomy, self._climbed = self._rung + 1, 0, True

    def _fall(self, seconds: float) -> None:
        if self._climbed:
            self._patience = min(2 * self._patience, _LONGEST)
        before = self.divisor
        for _ in range(_DROP):
            if self._rung and seconds * (before / self.divisor) ** 2 > self.budget:
                self._rung -= 1
        self._roomy, self._climbed = 0, False
