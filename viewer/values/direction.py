"""Principal directions of the latent codes, along which sliders move an object."""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, CodeKind, Codes


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction in the space of one of the two codes."""

    kind: CodeKind
    step: Float[Tensor, "latent"]  # one standard deviation of the trained codes along the direction

    @classmethod
    def principal(cls, book: CodeBook, kind: CodeKind, index: int) -> "Direction":
        """Return a principal direction of the trained codes; 0 has the largest variance."""
        space = book.shape_space if kind == "shape" else book.texture_space
        return cls(kind, space.basis[index])

    def strength(self, codes: Codes, mean: Codes) -> float:
        """Return the position of codes along the direction, in standard deviations from ``mean``."""
        way = getattr(codes, self.kind) - getattr(mean, self.kind)
        return float(way @ self.step / self.step.square().sum())

    def moved(self, codes: Codes, mean: Codes, to: float) -> Codes:
        """Return the codes moved along the direction to the position ``to``, in standard deviations."""
        by = to - self.strength(codes, mean)
        return replace(codes, **{self.kind: getattr(codes, self.kind) + by * self.step})
