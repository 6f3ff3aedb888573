"""A bend of the vertical axis: lengths below and above a plane change, those of the whole do not."""

from dataclasses import astuple, dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits.edit import Edit

MAX_BEND = 4.0  # largest factor by which lengths below or above the plane grow or shrink
_ROUNDING = 1 + 1e-6  # factor by which lengths computed from a bend at its limits may exceed them


@dataclass(frozen=True)
class Bend(Edit):
    """A piecewise linear map of heights that moves a plane and keeps everything outside of two ends.

    Raises ``ValueError`` for a plane at or beyond an end, or too far from its place before.

    Example:
        >>> bend = Bend(-0.5, -0.1, 0.1, 0.5)
        >>> bend.destinations(torch.tensor([[0.0, 0.0, -0.1], [0.3, 0.0, 0.2]]))[:, 2]
        tensor([0.1000, 0.3000])
    """

    low: float  # scene units, the lower end
    plane: float  # height of the plane before
    moved: float  # height of the plane after
    high: float  # the upper end

    key = "bend"
    subject = "size"
    is_separable = True
    glsl = """
uniform float bend[4];  // heights: lower end, plane before, plane after, upper end
vec3 bend_origins(vec3 point) {
    float below = (point.z - bend[0]) / (bend[2] - bend[0]), above = (bend[3] - point.z) / (bend[3] - bend[2]);
    return point + vec3(0.0, 0.0, (bend[1] - bend[2]) * max(min(below, above), 0.0));
}
"""

    def __post_init__(self) -> None:
        if not (self.low < min(self.plane, self.moved) and max(self.plane, self.moved) < self.high):  # also for NaN
            raise ValueError(f"a bend moves a plane between two ends, got {self}")
        factors = (self.moved - self.low) / (self.plane - self.low), (self.high - self.moved) / (self.high - self.plane)
        limit = _ROUNDING * MAX_BEND
        if not all(1 / limit <= factor <= limit for factor in factors):
            raise ValueError(f"a bend changes lengths by a factor of {MAX_BEND:g} at most, got {self}")

    @property
    def is_none(self) -> bool:
        """True for a plane that stays."""
        return self.moved == self.plane

    def destinations(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
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

    def uniforms(self) -> dict[str, Any]:
        """Return the four heights."""
        return {"bend": astuple(self)}

    @classmethod
    def between(cls, first: "Bend | None", second: "Bend | None", amount: float) -> "Bend":
        """Interpolate linearly; None stands for a plane that stays."""
        if first and second:
            numbers = zip(astuple(first), astuple(second), strict=True)
            return Bend(*((1 - amount) * start + amount * end for start, end in numbers))
        bend = first or second
        assert bend is not None
        fraction = 1 - amount if first else amount
        return Bend(bend.low, bend.plane, bend.plane + fraction * (bend.moved - bend.plane), bend.high)
