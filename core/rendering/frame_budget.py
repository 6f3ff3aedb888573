"""The frame budget: how coarse the first frame must be to keep up with the input on this machine."""

import math

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)  # Divisor of the image size for the first frame.
_HEADROOM = 0.7  # share of the time for rays: a first frame that takes less allows a finer one
_MIN_HEIGHT = 64  # px of a first frame: a smaller one hardly takes less time, and shows nothing
_MAX_DROP = 2  # levels at a time, at most: one disturbance must not spoil the image
_FRAMES_BEFORE_FINER, _MAX_FRAMES_BEFORE_FINER = 3, 96
"""Frames in a row with headroom before a finer one is tried; twice as many each time that it was too slow, unless it
would fit even if all of the time but the fixed part grew with the size: so the image is fine again soon after other
work has ended."""
_FIXED_COST_EXPIRES = 60  # frames after which the fixed part is estimated anew, by a smaller one
_OUTDATED = 0.7
"""share of the fixed part, or of a coarser frame's time: a frame that takes less shows that the estimate is outdated,
as other work has ended or another thing moves"""


class FrameBudget:
    """The size of the first frame, from a model of its time: fixed + rays * cost.

    Fixed is above all a new shape's occupied cells. Both are estimated from two frames of two sizes in a row; where no
    coarser one is allowed, a finer one is tried for that. The largest size within the budget is taken: coarser at
    once, finer a level at a time, after ever more frames each time that it was too slow (exponential back-off). Where
    the fixed part takes most of the budget, rays get up to half as long again. No first frame is lower than 64 px, if
    the image is not.
    """

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget  # s for the first frame while something moves
        self._level, self._floor, self._height = _DIVISORS.index(divisor), 0, 0
        self._learnt = divisor, 0  # divisor that was last changed to, and the height of image that it is for
        self._headroom, self._patience, self._refined = 0, _FRAMES_BEFORE_FINER, False
        self._fixed = 0.0  # s that a frame of any size takes, as far as is known
        self._fixed_expires_in = 0  # frames for which that holds, unless it is outdated before
        self._last = divisor, 0.0  # divisor and s of the newest frame

    @property
    def divisor(self) -> int:
        """Divisor of the image size for the next first frame."""
        return _DIVISORS[self._level]

    @property
    def limit(self) -> float:
        """s that a first frame may take: the budget, unless most of it goes whatever the size."""
        return max(self.budget, 1.5 * self._fixed - 0.4 * self.budget)

    def divisors(self, height: int) -> tuple[int, ...]:
        """Divisors of the size of an image so many px high: the first frame's, then 1/4, 1/2 and full size, and full
        size once more.
        """
        high_enough = (height >= _MIN_HEIGHT * divisor or divisor == 1 for divisor in _DIVISORS)
        self._floor = list(high_enough).index(True)
        if height != self._height:
            self._learnt = self._learnt[0], self._learnt[1] or height
            self._level, self._height = self._level_for(height), height
            self._last = _DIVISORS[self._level], 0.0
        self._level = max(self._level, self._floor)
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def _level_for(self, height: int) -> int:
        """Whose first frame has about as many pixels as that which was learnt."""
        divisor, learnt_height = self._learnt
        wanted = divisor * height / learnt_height
        return min(range(len(_DIVISORS)), key=lambda level: abs(math.log(_DIVISORS[level] / wanted)))

    def observe(self, divisor: int, seconds: float) -> None:
        """Learn from the time that a first frame with this divisor took."""
        if divisor != self.divisor:
            return
        self._find_fixed(divisor, seconds)
        if seconds > self.limit and self._level > self._floor:
            self._coarsen(seconds)
        elif self._comfortable < seconds <= self.limit:
            self._headroom = 0
        else:
            self._headroom += 1
            if self._level + 1 < len(_DIVISORS) and self._headroom >= self._patience_for(seconds):
                self._level, self._headroom, self._refined = self._level + 1, 0, True
                self._learnt = self.divisor, self._height

    @property
    def _comfortable(self) -> float:
        """s of a first frame that leaves room for a finer one."""
        return self._fixed + _HEADROOM * (self.limit - self._fixed)

    def _find_fixed(self, divisor: int, seconds: float) -> None:
        """Time of a frame without rays, by frames of two sizes; never more than either takes.

        Nothing is known where the finer one was the faster one, or where a frame is faster than should be possible.
        """
        (rays_before, before), (rays, now) = (self._last[0] ** -2, self._last[1]), (divisor**-2, seconds)
        if rays_before != rays:
            (_, coarse), (_, fine) = sorted([(rays_before, before), (rays, now)])
            each = max(0.0, (now - before) / (rays - rays_before))
            self._fixed = max(0.0, min(now - each * rays, before - each * rays_before))
            self._fixed, self._fixed_expires_in = self._fixed * (fine > _OUTDATED * coarse), _FIXED_COST_EXPIRES
        self._fixed_expires_in -= 1
        self._fixed = min(self._fixed, now) if self._fixed_expires_in > 0 and now > _OUTDATED * self._fixed else 0.0
        self._last = divisor, seconds

    def _predicted(self, seconds: float, divisor: int, level: int) -> float:
        """s of a frame at a level, where one with this divisor took so long."""
        return self._fixed + (seconds - self._fixed) * (divisor / _DIVISORS[level]) ** 2

    def _patience_for(self, seconds: float) -> int:
        """Frames with headroom before a finer one is tried, where the last one took so long."""
        finer = self._predicted(seconds, self.divisor, self._level + 1)
        return _FRAMES_BEFORE_FINER if finer <= self._comfortable else self._patience

    def _coarsen(self, seconds: float) -> None:
        if self._refined:
            self._patience = min(2 * self._patience, _MAX_FRAMES_BEFORE_FINER)
        before = self.divisor
        for _ in range(_MAX_DROP):
            if self._level > self._floor and self._predicted(seconds, before, self._level) > self.limit:
                self._level -= 1
        self._headroom, self._refined = 0, False
        self._learnt = self.divisor, self._height
