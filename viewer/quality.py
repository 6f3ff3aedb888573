"""How coarse a first picture must be so that it follows the hand."""

_FIRST_WITHIN = 0.05
"""s: what still feels like following."""
_COARSEST, _FINEST = 16, 4
"""What the size of the first picture is divided by."""


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
