"""Principal directions of the latent codes, along which sliders move an object."""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, Codes
from viewer.values.part import Part


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction in the space of one of the two codes."""

    part: Part
    step: Float[Tensor, "latent"]  # one standard deviation of the trained codes along the direction

    @classmethod
    def principal(cls, book: CodeBook, part: Part, index: int) -> "Direction":
        """Return a principal direction of the trained codes; 0 has the largest variance."""
        space = book.shape_space if part == "shape" else book.texture_space
        return cls(part, space.basis[index])

    def strength(self, codes: Codes, mean: Codes) -> float:
        """Return the position of codes along the direction, in standard deviations from ``mean``."""
        way = getattr(codes, self.part) - getattr(mean, self.part)
        return float(way @ self.step / self.step.square().sum())

    def moved(self, codes: Codes, mean: Codes, to: float) -> Codes:
        """Return the codes moved along the direction to the position ``to``, in standard deviations."""
        by = to - self.strength(codes, mean)
        return replace(codes, **{self.part: getattr(codes, self.part) + by * self.step})
