"""Principal directions of the latent codes, along which sliders move an object."""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, CodeKind, Codes
from core.models.model import Model
from core.rendering.motion import moved_along, reach

_TEXTURE_REACH = 3.0  # standard deviations to either side of the mean; no texture breaks an object


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction in the space of one of the two codes."""

    kind: CodeKind
    step: Float[Tensor, "latent"]  # one standard deviation of the trained codes along the direction
    index: int  # among the principal directions

    @classmethod
    def principal(cls, book: CodeBook, kind: CodeKind, index: int) -> "Direction":
        """Return a principal direction of the trained codes; 0 has the largest variance."""
        space = book.shape_space if kind == "shape" else book.texture_space
        return cls(kind, space.basis[index], index)

    def strength(self, codes: Codes, mean: Codes) -> float:
        """Return the position of codes along the direction, in standard deviations from ``mean``."""
        way = getattr(codes, self.kind) - getattr(mean, self.kind)
        return float(way @ self.step / self.step.square().sum())

    def reach(self, model: Model, codes: Codes) -> tuple[float, float]:
        """Return the least and the greatest position of an object along the direction."""
        return reach(model, codes, self.index) if self.kind == "shape" else (-_TEXTURE_REACH, _TEXTURE_REACH)

    def moved(self, model: Model, codes: Codes, to: float) -> Codes:
        """Return the codes moved to the position ``to``, in standard deviations, or to the end of their reach."""
        if self.kind == "shape":
            return moved_along(model, codes, self.index, to)
        by = max(-_TEXTURE_REACH, min(_TEXTURE_REACH, to)) - self.strength(codes, model.codes.mean)
        return replace(codes, texture=codes.texture + by * self.step)
