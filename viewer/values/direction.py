"""Straight ways through the codes, along which a slider changes an object: principal directions."""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, Codes
from viewer.values.part import Part


@dataclass(frozen=True, eq=False)
class Direction:
    """A way that changes one code and leaves the other as it is."""

    part: Part
    step: Float[Tensor, "latent"]  # one standard deviation of the trained codes

    @classmethod
    def principal(cls, book: CodeBook, part: Part, index: int) -> "Direction":
        """One of the principal directions of the trained codes."""
        space = book.shape_space if part == "shape" else book.texture_space
        return cls(part, space.basis[index])

    def strength(self, codes: Codes, mean: Codes) -> float:
        """How far codes are along it, in standard deviations from the mean."""
        way = getattr(codes, self.part) - getattr(mean, self.part)
        return float(way @ self.step / self.step.square().sum())

    def moved(self, codes: Codes, mean: Codes, to: float) -> Codes:
        """The codes with another strength; nothing across it changes."""
        by = to - self.strength(codes, mean)
        return replace(codes, **{self.part: getattr(codes, self.part) + by * self.step})
