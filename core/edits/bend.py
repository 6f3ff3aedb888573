"""A bend of the vertical axis: lengths below and above a plane change, those of the whole do not."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

MAX_BEND = 4.0  # largest factor by which lengths below or above the plane grow or shrink
_ROUNDING = 1 + 1e-6  # factor by which lengths computed from a bend at its limits may exceed them


@dataclass(frozen=True)
class Bend:
    """A piecewise linear map of heights that moves a plane and keeps everything outside of two ends.

    Raises ``ValueError`` for a plane at or beyond an end, or too far from its place before.

    Example:
        >>> bend = Bend(-0.5, -0.1, 0.1, 0.5)
        >>> bend.bent(torch.tensor([[0.0, 0.0, -0.1], [0.3, 0.0, 0.2]]))[:, 2]
        tensor([0.1000, 0.3000])
    """

    low: float  # scene units, the lower end
    plane: float  # height of the plane before
    moved: float  # height of the plane after
    high: float  # the upper end

    def __post_init__(self) -> None:
        if not (self.low < min(self.plane, self.moved) and max(self.plane, self.moved) < self.high):  # also for NaN
            raise ValueError(f"a bend moves a plane between two ends, got {self}")
        factors = (self.moved - self.low) / (self.plane - self.low), (self.high - self.moved) / (self.high - self.plane)
        limit = _ROUNDING * MAX_BEND
        if not all(1 / limit <= factor <= limit for factor in factors):
            raise ValueError(f"a bend changes lengths by a factor of {MAX_BEND:g} at most, got {self}")

    def bent(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places of points after the bend."""
        return self._shifted(points, self.plane, self.moved)

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places that points of the bent object came from."""
        return self._shifted(points, self.moved, self.plane)

    def _shifted(self, points: Float[Tensor, "*batch 3"], start: float, end: float) -> Float[Tensor, "*batch 3"]:
        heights = points[..., 2]
        fractions = torch.minimum(
            (heights - self.low) / (start - self.low), (self.high - heights) / (self.high - start)
        )
        return torch.cat((points[..., :2], (heights + (end - start) * fractions.clamp_min(0))[..., None]), -1)


def mixed_bend(first: Bend | None, second: Bend | None, amount: float) -> Bend | None:
    """Interpolate linearly from the first bend (amount 0) to the second (1); None stands for a plane that stays."""
    if first is None or second is None:
        bend = first or second
        if bend is None:
            return None
        fraction = amount if first is None else 1 - amount
        return Bend(bend.low, bend.plane, bend.plane + fraction * (bend.moved - bend.plane), bend.high)
    numbers = zip(vars(first).values(), vars(second).values(), strict=True)
    return Bend(*((1 - amount) * start + amount * end for start, end in numbers))
