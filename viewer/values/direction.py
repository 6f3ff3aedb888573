"""Principal directions of the latent codes, along which sliders move an object."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, CodeKind
from core.models.model import Instance


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

    def strength(self, instance: Instance) -> float:
        """Return an object's position along the direction, in standard deviations from its model's mean."""
        way = getattr(instance.codes, self.kind) - getattr(instance.model.codes.mean, self.kind)
        return float(way @ self.step / self.step.square().sum())

    def moved(self, instance: Instance, to: float) -> Instance:
        """Return an object moved along the direction to the position ``to``, in standard deviations."""
        return instance.moved(self.kind, (to - self.strength(instance)) * self.step)
