"""A smooth map of space, by cubic polynomials: an edited object is the one that it was made from, seen through it."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits.edit import Edit
from core.geometry.camera import Factors

TERMS = [(x, y, z) for x in range(4) for y in range(4 - x) for z in range(4 - x - y)]  # exponents of the polynomials
MAX_STEPS = 6  # directions that a warp may follow
_YZ_TERMS = [(y, z) for y in range(4) for z in range(4 - y)]
_PLACES = [x for x, *_ in TERMS], [_YZ_TERMS.index((y, z)) for _, y, z in TERMS]  # of the terms in a table by x
_MOST = 10.0  # of a step and of a coefficient
_SUM = " + ".join(f"x[{a}] * y[{b}] * z[{c}] * warp[{term}]" for term, (a, b, c) in enumerate(TERMS))
_SOLID = 22.0  # optical depth of half the scene's box from which a place is solid: ln 2 for a cell of 64


@dataclass(frozen=True)
class Warp(Edit):
    """A map from the places of an edited object to those that they came from. Raises ``ValueError`` for odd numbers."""

    steps: tuple[float, ...]  # standard deviations along the first shape directions, which the places moved
    extent: Factors  # half the size of the scene's box
    coefficients: tuple[tuple[float, float, float], ...]  # of a displacement in scene units, for each monomial
    strain: float  # by which lengths change at most

    key = "warp"
    subject = "shape"
    glsl = f"""
uniform vec3 warp[{len(TERMS)}], warp_extent;
vec3 warp_origins(vec3 point) {{
    vec3 p = clamp(point / warp_extent, -1.0, 1.0);
    vec4 x = vec4(1.0, p.x, p.x * p.x, p.x * p.x * p.x), y = vec4(1.0, p.y, p.y * p.y, p.y * p.y * p.y);
    vec4 z = vec4(1.0, p.z, p.z * p.z, p.z * p.z * p.z);
    return clamp(point + {_SUM}, -warp_extent, warp_extent);
}}
"""

    def __post_init__(self) -> None:
        if not 1 <= len(self.steps) <= MAX_STEPS or len(self.coefficients) != len(TERMS):
            raise ValueError(f"a warp has 1 to {MAX_STEPS} steps and {len(TERMS)} coefficients")
        numbers = (*self.steps, *(number for term in self.coefficients for number in term))
        if not all(abs(number) <= _MOST for number in numbers) or not 0 <= self.strain <= 1:  # also for NaN
            raise ValueError(f"a warp's steps and coefficients are at most {_MOST:g}, and its strain 0 to 1")
        if not all(0 < side < math.inf for side in self.extent):
            raise ValueError(f"a warp is of a box, got {self.extent}")

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places that points of the edited object came from."""
        extent = points.new_tensor(self.extent)
        table = points.new_zeros(4, len(_YZ_TERMS), 3)
        table[_PLACES] = points.new_tensor(self.coefficients)
        # A small product for y and z, and Horner's rule for x: several times faster than a product of all monomials.
        x, y, z = (points / extent).clamp(-1, 1).reshape(-1, 3).T.contiguous().unbind()
        powers = [(torch.ones_like(value), value, value * value, value * value * value) for value in (y, z)]
        yz = torch.stack([powers[0][b] * powers[1][c] for b, c in _YZ_TERMS])
        constant, linear, square, cube = (table.mT @ yz).unbind()
        shift = constant + x * (linear + x * (square + x * cube))
        moved = points + shift.T.reshape(points.shape)
        return torch.maximum(torch.minimum(moved, extent), -extent)

    def densities(self, densities: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        """Return densities at origins as those of the edited object: no solid part becomes more transparent."""
        solid = _SOLID / max(self.extent)
        return densities * (1 + self.strain * densities.square() / (densities.square() + solid**2))

    def fits(self, extent: Factors, directions: int) -> bool:
        """Return whether the warp is one of a model's box and directions."""
        return len(self.steps) == min(MAX_STEPS, directions) and all(map(math.isclose, self.extent, extent))

    def uniforms(self) -> dict[str, Any]:
        """Return the coefficients, and the box."""
        return {"warp": self.coefficients, "warp_extent": self.extent}

    @classmethod
    def between(cls, first: "Warp | None", second: "Warp | None", amount: float) -> "Warp":
        """Interpolate linearly; None stands for no motion. Raises ``ValueError`` for warps of different directions."""
        weighted = [(warp, weight) for warp, weight in ((first, 1 - amount), (second, amount)) if warp]
        columns = zip(*([weight * number for number in warp._numbers] for warp, weight in weighted), strict=True)
        numbers = tuple(map(sum, columns))
        count = len(weighted[0][0].steps)
        x, y, z = (numbers[count + axis : -1 : 3] for axis in range(3))
        return Warp(numbers[:count], weighted[0][0].extent, tuple(zip(x, y, z, strict=True)), min(numbers[-1], 1.0))

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (*self.steps, *(number for term in self.coefficients for number in term), self.strain)


def monomials(points: Float[Tensor, "*batch 3"], extent: Float[Tensor, "3"]) -> Float[Tensor, "*batch terms"]:
    """Return the products of powers (:data:`TERMS`) of points' coordinates, -1..1 in the scene's box."""
    unit_points = (points / extent).clamp(-1, 1)
    x, y, z = torch.stack([unit_points**power for power in range(4)]).unbind(-1)
    return torch.stack([x[a] * y[b] * z[c] for a, b, c in TERMS], -1)
