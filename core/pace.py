"""The frame budget: how coarse a picture must begin so that it follows the hand on this machine."""

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)
"""What the size of the first picture is divided by; the coarsest is the floor."""
_SAFE = 0.85
"""of the budget that a finer beginning may be expected to take"""
_PATIENCE = 3
"""frames in a row that would have had room for a finer beginning, before it is tried"""


class Pace:
    """Learns from first pictures what they take. Too slow: at once coarser. Room to spare for a while: a step finer."""

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget
        """s for the first picture while something moves"""
        self._rung = _DIVISORS.index(divisor)
        self._roomy = 0

    @property
    def divisor(self) -> int:
        """What the size of the next first picture is divided by."""
        return _DIVISORS[self._rung]

    @property
    def stages(self) -> tuple[int, ...]:
        """Divisors of a picture's size: from the first picture over 1/4, 1/2 and the whole to the whole once more."""
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def seen(self, divisor: int, seconds: float) -> None:
        """Take in what a first picture took, which began at this divisor.

        Cost is taken to grow with the number of pixels, which overrates what is won by fewer and lost by more of them:
        it is corrected by the next picture.
        """
        if divisor != self.divisor:
            return
        if seconds > self.budget:
            self._roomy = 0
            while self._rung and seconds * (divisor / self.divisor) ** 2 > _SAFE * self.budget:
                self._rung -= 1
        elif self._rung + 1 < len(_DIVISORS):
            finer = seconds * (divisor / _DIVISORS[self._rung + 1]) ** 2
            self._roomy = self._roomy + 1 if finer < _SAFE * self.budget else 0
            if self._roomy == _PATIENCE:
                self._rung, self._roomy = self._rung + 1, 0
