"""How coarse a first picture must be so that it follows the hand, and how fine the last one is wanted."""

from typing import NamedTuple

_FIRST_WITHIN = 0.05
"""s: what still feels like following."""
_COARSEST, _FINEST = 16, 4
"""What the size of the first picture is divided by."""


class Quality(NamedTuple):
    """Of the finished picture."""

    detail: int
    """px along its shorter side"""
    samples: int
    """intervals along the longest side of the scene's box"""


QUALITIES = (
    Quality(96, 64),
    Quality(128, 96),
    Quality(192, 128),
    Quality(256, 192),
    Quality(384, 192),
    Quality(512, 192),
    Quality(768, 256),
)
"""From faster to finer; each takes about twice as long as the one before."""
USUAL = 3


class Speed:
    """Rays per second, as lately seen on this machine with this model."""

    def __init__(self, rate: float = 50_000.0) -> None:
        self.rate = rate

    def seen(self, rays: int, seconds: float) -> None:
        """Take in a measurement; half of it, as one may have been disturbed."""
        self.rate = (self.rate + rays / max(seconds, 1e-4)) / 2

    def stages(self, rays: int) -> tuple[int, ...]:
        """Divisors of the picture's size: the first one done in time, at least one between, and then the whole."""
        divisor = _COARSEST
        while divisor > _FINEST and rays / (divisor // 2) ** 2 / self.rate < _FIRST_WITHIN:
            divisor //= 2
        steps = [divisor]
        while steps[-1] > 1:
            steps.append(steps[-1] // 2)
        return tuple(steps)
