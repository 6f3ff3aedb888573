"""Shape and texture codes: a pair for an object, the book of a trained model, and the space its codes span."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Codes:
    """One shape code and one texture code, or a batch of pairs. Raises ``ValueError`` where a number is not finite."""

    shape: Float[Tensor, "*batch shape_latent"]
    texture: Float[Tensor, "*batch texture_latent"]

    def __post_init__(self) -> None:
        if not bool(torch.isfinite(self.shape).all() and torch.isfinite(self.texture).all()):
            raise ValueError("codes must be finite")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Codes):
            return NotImplemented
        return torch.equal(self.shape, other.shape) and torch.equal(self.texture, other.texture)

    def __hash__(self) -> int:
        return hash((*self.shape.tolist(), *self.texture.tolist()))

    def mixed(self, other: "Codes", shape: float, texture: float) -> "Codes":
        """These codes at 0, the other's at 1, straight lines between, for shape and texture separately."""
        return Codes(torch.lerp(self.shape, other.shape, shape), torch.lerp(self.texture, other.texture, texture))


@dataclass(frozen=True, eq=False)
class CodeSpace:
    """The cloud of one kind of trained codes: its mean and its principal directions, strongest first."""

    mean: Float[Tensor, "latent"]
    directions: Float[Tensor, "rank latent"]
    """orthonormal rows"""
    spread: Float[Tensor, "rank"]
    """standard deviation along each direction, descending"""

    @classmethod
    def of(cls, codes: Float[Tensor, "objects latent"]) -> "CodeSpace":
        """PCA of the rows; the sign of each direction is fixed by its largest component."""
        # Kept for good, so no tensor of inference: whoever asks first may be drawing, and a fit needs gradients.
        with torch.inference_mode(False), torch.no_grad():
            mean = codes.mean(0)
            _, singular, directions = torch.linalg.svd(codes - mean, full_matrices=False)
            spread = singular / max(1, len(codes) - 1) ** 0.5
            kept = spread > 1e-6 * spread.max().clamp_min(1e-12)
            directions, spread = directions[kept], spread[kept]
            largest = directions.gather(1, directions.abs().argmax(1, keepdim=True))
            return cls(mean, directions * largest.sign(), spread)

    @classmethod
    def raw(cls, latent: int) -> "CodeSpace":
        """A cloud in whose coordinates a code is what it is."""
        return cls(torch.zeros(latent), torch.eye(latent), torch.ones(latent))

    def coordinates(self, code: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch rank"]:
        """A code in standard deviations along the principal directions."""
        return (code - self.mean) @ self.directions.T / self.spread

    def code(self, coordinates: Float[Tensor, "*batch some"]) -> Float[Tensor, "*batch latent"]:
        """The code at these coordinates (standard deviations); directions left out count as zero."""
        return self.mean + coordinates @ self.axes(coordinates.shape[-1])

    def axes(self, some: int) -> Float[Tensor, "some latent"]:
        """What each of the first coordinates moves a code by per standard deviation; fewer where there are not so many
        directions.
        """
        return self.spread[:some, None] * self.directions[:some]

    def moved(self, code: Float[Tensor, "latent"], direction: int, to: float) -> Float[Tensor, "latent"]:
        """The same code with one coordinate set to ``to`` standard deviations; nothing else changes."""
        step = to - float(self.coordinates(code)[direction])
        return code + step * self.spread[direction] * self.directions[direction]

    def distance(
        self, code: Float[Tensor, "*batch latent"], start: Float[Tensor, "*#batch latent"] | None = None
    ) -> Float[Tensor, "*batch"]:
        """How far a code is from another, or from the mean: the root mean square of the coordinates between.

        In standard deviations: over the cloud, the mean square of the distance from the mean is 1.
        """
        return self.coordinates(code if start is None else code - start + self.mean).square().mean(-1).sqrt()

    @property
    def explained(self) -> Float[Tensor, "rank"]:
        """The share of the cloud's variance along each direction."""
        return self.spread**2 / (self.spread**2).sum()


class Entry(NamedTuple):
    """An object of a code book: a name and the rows of its shape and its texture code."""

    name: str
    shape: int
    texture: int


@dataclass(frozen=True, eq=False)
class CodeBook:
    """The codes of a trained model. Objects may share a shape or a texture, so each kind has its own rows."""

    shapes: Float[Tensor, "shapes shape_latent"]
    textures: Float[Tensor, "textures texture_latent"]
    objects: tuple[Entry, ...]
    broken: frozenset[int] = frozenset()
    """Objects that training lost and that show next to nothing: still there by their index, but not in the clouds."""

    def __post_init__(self) -> None:
        if not self.broken <= set(range(len(self.objects))):
            raise ValueError(f"broken objects {sorted(self.broken)} of a book of {len(self.objects)}")
        for entry in self.objects:
            if not (0 <= entry.shape < len(self.shapes) and 0 <= entry.texture < len(self.textures)):
                raise ValueError(f"object {entry.name} has codes outside the book")

    def __len__(self) -> int:
        return len(self.objects)

    def __getitem__(self, index: int) -> Codes:
        if not 0 <= index < len(self.objects):
            raise ValueError(f"object must be 0 to {len(self.objects) - 1}, got {index}")
        entry = self.objects[index]
        return Codes(self.shapes[entry.shape], self.textures[entry.texture])

    @cached_property
    def sound(self) -> tuple[int, ...]:
        """The objects that are not broken."""
        return tuple(index for index in range(len(self.objects)) if index not in self.broken)

    @cached_property
    def shape_space(self) -> CodeSpace:
        """The cloud of the shape codes."""
        return CodeSpace.of(self._sound_rows(self.shapes, [entry.shape for entry in self.objects]))

    @cached_property
    def texture_space(self) -> CodeSpace:
        """The cloud of the texture codes."""
        return CodeSpace.of(self._sound_rows(self.textures, [entry.texture for entry in self.objects]))

    @property
    def mean(self) -> Codes:
        """The mean shape in the mean texture, where the paper's fit begins."""
        return Codes(self.shape_space.mean, self.texture_space.mean)

    def nearest_shape(self, code: Float[Tensor, "shape_latent"]) -> int:
        """The sound object with the nearest shape, by :meth:`CodeSpace.distance`.

        Raises ``ValueError`` where there is no such object.
        """
        return self._nearest(self.shape_space, self.shapes, [self.objects[index].shape for index in self.sound], code)

    def nearest_texture(self, code: Float[Tensor, "texture_latent"]) -> int:
        """The sound object with the nearest texture, as :meth:`nearest_shape`."""
        rows = [self.objects[index].texture for index in self.sound]
        return self._nearest(self.texture_space, self.textures, rows, code)

    def drawn(self, generator: torch.Generator) -> Codes:
        """A pair drawn from the two clouds, taken as normal."""
        shape, texture = (
            space.code(torch.randn(len(space.spread), generator=generator))
            for space in (self.shape_space, self.texture_space)
        )
        return Codes(shape, texture)

    def _nearest(self, space: CodeSpace, codes: Tensor, rows: list[int], code: Tensor) -> int:
        """By the row of each sound object."""
        if not rows:
            raise ValueError("the book has no objects to compare with")
        return self.sound[int(space.distance(codes[rows], code).argmin())]

    def _sound_rows(self, codes: Tensor, rows: list[int]) -> Tensor:
        """Without the rows that only broken objects use."""
        lost = {rows[index] for index in self.broken} - {rows[index] for index in self.sound}
        return codes[[row for row in range(len(codes)) if row not in lost]] if lost else codes
