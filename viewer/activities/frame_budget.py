"""The frame budget: the highest resolution of first frames that keeps up with input on this machine."""

import math

_DIVISORS = (24, 16, 12, 8, 6, 5, 4, 3, 2, 1)  # divisors of the image size for the first frame
_HEADROOM = 0.7  # fraction of the time left for rays below which a frame has headroom for a finer one
_MIN_HEIGHT = 64  # px of a first frame: smaller ones are hardly faster, and useless
_MAX_DROP = 2  # levels per frame, so that one disturbance does not spoil the image
_FRAMES_BEFORE_FINER, _MAX_FRAMES_BEFORE_FINER = 3, 96
"""Frames in a row with headroom before a finer one is tried; the number doubles after each failed attempt.

The first number always applies if a finer frame is predicted to have headroom too. So the image recovers soon after
other work ends."""
_FIXED_COST_EXPIRES = 60  # frames for which an estimate of the fixed cost is valid
_OUTDATED = 0.7
"""A frame faster than this fraction of the fixed cost, or of a coarser frame's time, makes the estimate invalid."""


class FrameBudget:
    """The size of the first frame, from a model of its time: fixed + rays * cost.

    The fixed cost is mainly a new shape's occupied cells. Both costs are estimated from two consecutive frames of
    different sizes; above the budget at the coarsest size, a finer frame is tried for the estimate. The size approaches
    the largest within the :attr:`limit`: coarser immediately, finer by one level at a time with exponential back-off.
    First frames are at least 64 px high, if the image is.

    Args:
        budget: time of a first frame during motion, s.
        divisor: of the image size for the first of all frames.
    """

    def __init__(self, budget: float = 1 / 30, divisor: int = 8) -> None:
        self.budget = budget  # s for the first frame during motion
        self._level = _DIVISORS.index(divisor)
        self._floor = 0
        self._height = 0
        self._learnt = divisor, 0  # last divisor changed to, and the image height it applies to
        self._headroom = 0
        self._patience = _FRAMES_BEFORE_FINER
        self._refined = False
        self._fixed = 0.0  # s, estimated time of a frame without rays
        self._fixed_expires_in = 0  # frames until the estimate expires
        self._last = divisor, 0.0  # divisor and s of the newest frame

    @property
    def divisor(self) -> int:
        """Divisor of the image size for the next first frame."""
        return _DIVISORS[self._level]

    @property
    def limit(self) -> float:
        """Longest time of a first frame, s: the budget, or more if the fixed cost takes most of it."""
        return max(self.budget, 1.5 * self._fixed - 0.4 * self.budget)

    def divisors(self, height: int) -> tuple[int, ...]:
        """Return the divisors of all stages for an image height (px).

        The first frame's, then those of 4, 2 and 1 that are smaller, then 1 again for the final number of samples.
        """
        high_enough = (height >= _MIN_HEIGHT * divisor or divisor == 1 for divisor in _DIVISORS)
        self._floor = list(high_enough).index(True)
        if height != self._height:
            self._learnt = self._learnt[0], self._learnt[1] or height
            self._level = self._level_for(height)
            self._height = height
            self._last = _DIVISORS[self._level], 0.0
        self._level = max(self._level, self._floor)
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def _level_for(self, height: int) -> int:
        """Return the level at which a first frame has about as many pixels as at the last learnt size."""
        divisor, learnt_height = self._learnt
        same_pixels = divisor * height / learnt_height
        return min(range(len(_DIVISORS)), key=lambda level: abs(math.log(_DIVISORS[level] / same_pixels)))

    def observe(self, divisor: int, seconds: float) -> None:
        """Update the estimates with the time of a first frame, s; frames with an earlier divisor are ignored."""
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
                self._level = self._level + 1
                self._headroom = 0
                self._refined = True
                self._learnt = self.divisor, self._height

    @property
    def _comfortable(self) -> float:
        """Time up to which a first frame has headroom for a finer one, s."""
        return self._fixed + _HEADROOM * (self.limit - self._fixed)

    def _find_fixed(self, divisor: int, seconds: float) -> None:
        """Estimate the fixed cost from the last two frames if their sizes differ; at most the time of either.

        An estimate becomes 0 when it expires or is outdated (:data:`_OUTDATED`).
        """
        last_divisor, last_seconds = self._last
        if divisor != last_divisor:
            rays = divisor**-2  # relative to the full size
            last_rays = last_divisor**-2
            cost = max(0.0, (seconds - last_seconds) / (rays - last_rays))
            coarse, fine = (last_seconds, seconds) if rays > last_rays else (seconds, last_seconds)
            fixed = max(0.0, min(seconds - cost * rays, last_seconds - cost * last_rays))
            self._fixed = fixed if fine > _OUTDATED * coarse else 0.0
            self._fixed_expires_in = _FIXED_COST_EXPIRES
        self._fixed_expires_in -= 1
        is_valid = self._fixed_expires_in > 0 and seconds > _OUTDATED * self._fixed
        self._fixed = min(self._fixed, seconds) if is_valid else 0.0
        self._last = divisor, seconds

    def _predicted(self, seconds: float, divisor: int, level: int) -> float:
        """Predict the time of a frame at a level, s, from the time of a frame with a divisor."""
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
