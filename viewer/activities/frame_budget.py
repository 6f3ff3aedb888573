"""The frame budget: the highest resolution of first frames that keeps up with input on this machine."""

from core.geometry.camera import Camera

_SECONDS = 1 / 30  # for the rays of a first frame during motion
_DIVISORS = (1, 2, 3, 4, 5, 6, 8, 12, 16, 24)  # of the image size for the first frame
_MIN_HEIGHT = 64  # px of a first frame: smaller ones are hardly faster, and useless
_FINER = 0.7  # fraction of the time that a finer frame may take, so that sizes do not alternate
_SMOOTHING = 0.3  # fraction of a change of the rate, in logarithms, that one frame makes: times vary
_MAX_CHANGE = 2.0  # of the rate by one frame, so that one disturbance does not spoil the image


class FrameBudget:
    """Chooses the size of the first frame by the rays per second of earlier ones, ``rate`` before any was measured."""

    def __init__(self, rate: float = 150_000.0) -> None:
        self.rate = rate
        self.divisor = 1  # of the newest first frame

    def divisors(self, camera: Camera) -> tuple[int, ...]:
        """Return the divisors of all stages of an image.

        The first frame's, then those of 4, 2 and 1 that are smaller, then 1 again for the final number of samples.
        """
        side = min(camera.width, camera.height)
        high_enough = [divisor for divisor in _DIVISORS if side >= _MIN_HEIGHT * divisor or divisor == 1]
        rays = self.rate * _SECONDS
        limits = {divisor: rays * (_FINER if divisor < self.divisor else 1.0) for divisor in high_enough}
        fast = (divisor for divisor, limit in limits.items() if camera.width * camera.height <= limit * divisor**2)
        self.divisor = next(fast, high_enough[-1])
        return (self.divisor, *(divisor for divisor in (4, 2, 1) if divisor < self.divisor), 1)

    def observe(self, rays: int, seconds: float) -> None:
        """Update the rate with the rays of a first frame and their time, s; 0 is no measurement."""
        if seconds > 0:
            change = (rays / seconds / self.rate) ** _SMOOTHING
            self.rate *= max(1 / _MAX_CHANGE, min(_MAX_CHANGE, change))
