"""The frame budget: the resolution of the first frame that keeps up with input on this machine."""

import math

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)  # divisors of the image size for the first frame
_HEADROOM = 0.7  # fraction of the ray time below which a finer first frame is possible
_MIN_HEIGHT = 64  # px of a first frame: smaller ones are hardly faster, and useless
_MAX_DROP = 2  # levels per step, so that one disturbance does not spoil the image
_FRAMES_BEFORE_FINER, _MAX_FRAMES_BEFORE_FINER = 3, 96
"""Frames in a row with headroom before a finer one is tried; doubled after each failed attempt, unless a finer frame
fits even if its whole variable time grows with the size. So the image recovers soon after other work ends."""
_FIXED_COST_EXPIRES = 60  # frames after which a smaller frame estimates the fixed cost anew
_OUTDATED = 0.7
"""factor on the fixed cost, or on a coarser frame's time: faster frames show that the estimate is outdated"""


class FrameBudget:
    """The size of the first frame, from a model of its time: fixed + rays * cost.

    The fixed cost is mainly a new shape's occupied cells. Both costs are estimated from two consecutive frames of
    different sizes; if no coarser one is allowed, a finer one is tried for this. The largest size within the budget is
    chosen: coarser immediately, finer by one level at a time with exponential back-off. If the fixed cost takes most of
    the budget, rays may exceed it by half. First frames are at least 64 px high, if the image is.
    """

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget  # s for the first frame during motion
        self._level, self._floor, self._height = _DIVISORS.index(divisor), 0, 0
        self._learnt = divisor, 0  # last divisor changed to, and the image height it applies to
        self._headroom, self._patience, self._refined = 0, _FRAMES_BEFORE_FINER, False
        self._fixed = 0.0  # s, estimated time of a frame without rays
        self._fixed_expires_in = 0  # frames until the estimate expires
        self._last = divisor, 0.0  # divisor and s of the newest frame

    @property
    def divisor(self) -> int:
        """Divisor of the image size for the next first frame."""
        return _DIVISORS[self._level]

    @property
    def limit(self) -> float:
        """Allowed time of a first frame, s: the budget, or more if the fixed cost takes most of it."""
        return max(self.budget, 1.5 * self._fixed - 0.4 * self.budget)

    def divisors(self, height: int) -> tuple[int, ...]:
        """Return divisors for an image height (px): the first frame's, 1/4, 1/2, full size, and full size again."""
        high_enough = (height >= _MIN_HEIGHT * divisor or divisor == 1 for divisor in _DIVISORS)
        self._floor = list(high_enough).index(True)
        if height != self._height:
            self._learnt = self._learnt[0], self._learnt[1] or height
            self._level, self._height = self._level_for(height), height
            self._last = _DIVISORS[self._level], 0.0
        self._level = max(self._level, self._floor)
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def _level_for(self, height: int) -> int:
        """Return the level whose first frame has about as many pixels as the learnt one."""
        divisor, learnt_height = self._learnt
        wanted = divisor * height / learnt_height
        return min(range(len(_DIVISORS)), key=lambda level: abs(math.log(_DIVISORS[level] / wanted)))

    def observe(self, divisor: int, seconds: float) -> None:
        """Update the estimates with the time of a first frame with this divisor."""
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
        """Time of a first frame that leaves room for a finer one, s."""
        return self._fixed + _HEADROOM * (self.limit - self._fixed)

    def _find_fixed(self, divisor: int, seconds: float) -> None:
        """Estimate the fixed cost from frames of two sizes; at most the time of either.

        The estimate is discarded if the finer frame was faster, or a frame is faster than it allows.
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
        """Predict the time of a frame at a level, s, from a frame with this divisor."""
        return self._fixed + (seconds - self._fixed) * (divisor / _DIVISORS[level]) ** 2

    def _patience_for(self, seconds: float) -> int:
        """Return the number of frames with headroom before a finer one is tried."""
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
