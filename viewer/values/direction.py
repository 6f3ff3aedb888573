"""Principal directions of the latent codes, along which sliders move an object."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, CodeKind
from core.models.model import Instance
from core.models.motion import moved_along, position, reach

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

    def strength(self, instance: Instance) -> float:
        """Return an object's position along the direction, in standard deviations from its model's mean."""
        if self.kind == "shape":
            return position(instance, self.index)
        offset = instance.codes.texture - instance.model.codes.mean.texture
        return float(offset @ self.step / self.step.square().sum())

    def reach(self, instance: Instance) -> tuple[float, float]:
        """Return the least and the greatest position of an object along the direction."""
        return reach(instance, self.index) if self.kind == "shape" else (-_TEXTURE_REACH, _TEXTURE_REACH)

    def moved(self, instance: Instance, to: float) -> Instance:
        """Return the object moved to the position ``to``, in standard deviations, or to the end of its reach."""
        if self.kind == "shape":
            return moved_along(instance, self.index, to)
        by = max(-_TEXTURE_REACH, min(_TEXTURE_REACH, to)) - self.strength(instance)
        return instance.moved("texture", by * self.step)
