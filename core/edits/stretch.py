"""A stretch of space along the axes, which gives an object another width, depth and height."""

from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from core.edits.edit import UNIT, Edit
from core.geometry.camera import Factors
from core.runtime.reading import typed

LEAST, MOST = 0.01, 100.0  # factors of a side
MAX_DISTORTION = 10.0  # largest factor of a side relative to that of another one
_ROUNDING = 1 + 1e-6  # by which factors, computed from ones at their limits, may exceed these


@dataclass(frozen=True)
class Stretch(Edit):
    """Sides relative to those of the natural object. Raises ``ValueError`` for factors out of range."""

    factors: Factors

    key = "stretch"
    subject = "size"

    def __post_init__(self) -> None:
        within = all(LEAST / _ROUNDING <= factor <= MOST * _ROUNDING for factor in self.factors)
        if len(self.factors) != 3 or not within:
            raise ValueError(f"a side is {LEAST:g} to {MOST:g} times its natural one, got {self.factors}")
        if max(self.factors) > _ROUNDING * MAX_DISTORTION * min(self.factors):
            raise ValueError(f"a side is stretched at most {MAX_DISTORTION:g} times as much as another one")

    @property
    def is_none(self) -> bool:
        """True for sides as long as before."""
        return self.factors == UNIT

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places that points came from."""
        return points / points.new_tensor(self.factors)

    def destinations(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places of points after the stretch."""
        return points * points.new_tensor(self.factors)

    def with_side(self, axis: int, factor: float) -> "Stretch":
        """Return a stretch with another factor along an axis, as near to that as limits allow.

        Example:
            >>> Stretch((1.0, 1.0, 1.0)).with_side(2, 40.0)
            Stretch(factors=(1.0, 1.0, 10.0))
        """
        factors = list(self.factors)
        del factors[axis]
        shortest = max(LEAST, max(factors) / MAX_DISTORTION)
        limit = min(MOST, min(factors) * MAX_DISTORTION)
        factors.insert(axis, max(shortest, min(limit, factor)))
        return Stretch((factors[0], factors[1], factors[2]))

    @classmethod
    def between(cls, first: "Stretch | None", second: "Stretch | None", amount: float) -> "Stretch":
        """Interpolate linearly; None stands for ones."""
        ends = zip(first.factors if first else UNIT, second.factors if second else UNIT, strict=True)
        x, y, z = ((1 - amount) * start + amount * end for start, end in ends)
        return Stretch((x, y, z))

    def to_json(self) -> Any:
        """Return the three factors."""
        return self.factors

    @classmethod
    def from_json(cls, content: Any) -> "Stretch":
        """Read three factors. Raises ``ValueError`` for other content."""
        return Stretch(typed(Factors, content, name=cls.key))
