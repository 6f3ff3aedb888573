"""An edit of an object as a value: all that fields, renders, meshes, pages and files need to know of one.

A new kind of edit is a subclass of :class:`Edit` in a file of its own, and a row in :data:`core.edits.kinds.KINDS`.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, TypeVar

from jaxtyping import Float
from torch import Tensor

from core.geometry.camera import Factors
from core.runtime.reading import typed

Subject = Literal["texture", "shape", "size"]
Colour = Float[Tensor, "3"]
E = TypeVar("E", bound="Edit")
UNIT: Factors = (1.0, 1.0, 1.0)


class Edit:
    """An edit that changes nothing. Subclasses are frozen dataclasses with numbers as fields, compared by value."""

    key: ClassVar[str]  # of its kind in files
    subject: ClassVar[Subject]
    """The changed property. Edits of the texture go with the texture, all others with the shape. Those of the size come
    last: they move bounds exactly (:meth:`destinations`), and the natural object is without them."""
    most: ClassVar[int] = 1  # edits of this kind that an object has
    is_separable: ClassVar[bool] = False
    """each coordinate of an origin depends on the same coordinate of the point alone"""
    glsl: ClassVar[str] = ""
    """:meth:`origins` as a function ``vec3 KEY_origins(vec3 point)``, with its uniforms; "": space stays"""
    factors: Factors = UNIT
    """Lengths of an edit that scales space along the axes. Rays stay straight, so cameras undo it, and no field."""

    @property
    def is_none(self) -> bool:
        """True for numbers that change nothing."""
        return False

    def origins(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places that points of the edited object came from."""
        return points

    def destinations(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the places of points after the edit of a size, the inverse of :meth:`origins`."""
        raise NotImplementedError

    def densities(self, densities: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        """Return densities at origins as those of the edited object."""
        return densities

    def over(
        self,
        colours: Float[Tensor, "*places 3"],
        below: Float[Tensor, "*places 3"],
        parts: Mapping[str, Float[Tensor, "*places"]],
    ) -> Float[Tensor, "*places 3"]:
        """Return colours with the edit of a texture.

        Args:
            colours: the network's, which tell light and pattern.
            below: the same after earlier edits.
            parts: probabilities of the model's parts.
        """
        raise NotImplementedError

    def fits(self, extent: Factors, directions: int) -> bool:
        """Return whether a model has objects with this edit.

        Args:
            extent: half the sides of the model's box, outside which nothing shows.
            directions: of its shape codes along which its objects move; 0 if codes move alone.
        """
        return True

    def uniforms(self) -> dict[str, Any]:
        """Return the values of the uniforms in :attr:`glsl`."""
        return {}

    @classmethod
    def mixed(cls: type[E], first: tuple[E, ...], second: tuple[E, ...], amount: float) -> tuple[E, ...]:
        """Interpolate from the edits of this kind of one object (amount 0) to those of another (1)."""
        if first == second or amount in (0.0, 1.0):
            return second if amount == 1.0 else first
        return (cls.between(next(iter(first), None), next(iter(second), None), amount),)

    @classmethod
    def between(cls: type[E], first: E | None, second: E | None, amount: float) -> E:
        """Interpolate linearly; None stands for no edit, and never for both."""
        raise NotImplementedError

    def to_json(self) -> Any:
        """Return the edit as JSON, read by :meth:`from_json`."""
        return dict(vars(self))

    @classmethod
    def from_json(cls: type[E], content: Any) -> E:
        """Read an edit. Raises ``ValueError`` for other content."""
        return typed(cls, content, name=cls.key)
