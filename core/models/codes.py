"""Shape and texture codes: a pair for an object, the book of a trained model, and the space its codes span."""

import math
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits import kinds
from core.edits.edit import UNIT, E, Edit, Subject
from core.geometry.camera import Factors
from core.models.latents import CODE_KINDS, CodeKind, Latents, mixed_offsets
from core.models.photo_detail import PhotoDetail
from core.runtime.modes import usual_settings

__all__ = ["CODE_KINDS", "CodeBook", "CodeKind", "CodeSpace", "Codes", "Entry", "farthest_first"]


@dataclass(frozen=True, eq=False)
class Codes(Latents):
    """The latent numbers of an object of a model, with the photos of a fitted object, and its edits.

    Raises ``ValueError`` for too many edits of a kind.
    """

    detail: PhotoDetail | None = None
    """Photos of a fitted object. They follow the shape when codes are combined; a new texture paints over them."""
    edits: tuple[Edit, ...] = ()
    """Of the object that the network knows, in the order in which they are made (:mod:`core.edits`)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "edits", kinds.ordered(self.edits))

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, Codes):
            return NotImplemented
        same_detail = self.detail is value.detail or self.detail == value.detail
        return super().__eq__(value) and self.edits == value.edits and same_detail

    __hash__ = Latents.__hash__

    @property
    def shape_key(self) -> tuple[Hashable, ...]:
        """All numbers of the shape, and the edits of its space, as a comparable key."""
        return super().shape_key + self.space_edits

    @property
    def form_key(self) -> tuple[Hashable, ...]:
        """All numbers of the shape with its size: objects of a model with equal ones differ in colours alone."""
        return self.shape_key + self.factors

    @property
    def texture_key(self) -> tuple[Hashable, ...]:
        """All numbers of the texture, and its edits, as a comparable key."""
        return super().texture_key + self.edits_of("texture")

    def edits_of(self, *subjects: Subject) -> tuple[Edit, ...]:
        """Return the edits that change one of these."""
        return tuple(edit for edit in self.edits if edit.subject in subjects)

    @property
    def field_edits(self) -> tuple[Edit, ...]:
        """The edits that the field makes: all but those that cameras see."""
        return tuple(edit for edit in self.edits if edit.factors == UNIT)

    @property
    def space_edits(self) -> tuple[Edit, ...]:
        """The edits of the field that lead from the network's space to the object's own."""
        return tuple(edit for edit in self.field_edits if edit.subject != "texture")

    def of_kind(self, kind: type[E]) -> tuple[E, ...]:
        """Return the edits of a kind."""
        return tuple(edit for edit in self.edits if isinstance(edit, kind))

    def with_edits(self, kind: type[E], *edits: E) -> "Codes":
        """Return codes with these edits in place of those of the same kind."""
        return replace(self, edits=(*(edit for edit in self.edits if not isinstance(edit, kind)), *edits))

    @property
    def factors(self) -> Factors:
        """The lengths along each axis that cameras see, relative to those in the object's own space."""
        x, y, z = (math.prod(axis) for axis in zip(UNIT, *(edit.factors for edit in self.edits), strict=True))
        return x, y, z

    @property
    def scale(self) -> float:
        """The part of the factors that images do not show: their root mean square."""
        factors = self.factors
        return 1.0 if factors == UNIT else math.sqrt(sum(factor**2 for factor in factors) / 3)

    @property
    def proportions(self) -> Factors | None:
        """The factors in images: without their scale. None if no side changes relative to the others."""
        factors = self.factors
        if len(set(factors)) == 1:
            return None
        x, y, z = (factor / self.scale for factor in factors)
        return x, y, z

    @classmethod
    def of(cls, latents: Latents) -> "Codes":
        """Return latents as codes without photo detail."""
        return cls(latents.shape, latents.texture, latents.shape_offsets, latents.texture_offsets)

    def mixed(self, second: "Codes", shape: float, texture: float) -> "Codes":
        """Interpolate linearly between two objects' codes, offsets and edits.

        ``shape`` and ``texture`` are positions from 0 (these codes) to 1 (the second's). The photo detail is that of
        the nearer shape.
        """
        detail = self.detail if shape <= 0.5 else second.detail
        return Codes(
            torch.lerp(self.shape, second.shape, shape),
            torch.lerp(self.texture, second.texture, texture),
            mixed_offsets(self.shape_offsets, second.shape_offsets, shape),
            mixed_offsets(self.texture_offsets, second.texture_offsets, texture),
            detail,
            kinds.mixed(self.edits, second.edits, shape, texture),
        )

    def taking(self, kind: CodeKind, source: "Codes") -> "Codes":
        """Return these codes with the shape or the texture of another object, offsets included.

        A shape comes with its photo detail. Both come with their edits.
        """
        names = {"shape": ("shape", "shape_offsets", "detail"), "texture": ("texture", "texture_offsets")}[kind]
        shape, texture = (source, self) if kind == "shape" else (self, source)
        edits = *texture.edits_of("texture"), *shape.edits_of("shape", "size")
        return replace(self, edits=edits, **{name: getattr(source, name) for name in names})


@dataclass(frozen=True, eq=False)
class CodeSpace:
    """The distribution of one kind of trained codes: mean and principal directions, strongest first."""

    mean: Float[Tensor, "latent"]
    directions: Float[Tensor, "rank latent"]  # orthonormal rows
    std: Float[Tensor, "rank"]  # standard deviation along each direction, descending

    @classmethod
    def from_codes(cls, codes: Float[Tensor, "objects latent"]) -> "CodeSpace":
        """Fit a PCA to the rows, without directions of no variance; each direction's largest component is positive."""
        # Cached, so no inference tensor: the first caller may be rendering, and a fit needs gradients.
        with usual_settings(), torch.no_grad():
            mean = codes.mean(0)
            _, singular, directions = torch.linalg.svd(codes - mean, full_matrices=False)
            std = singular / max(1, len(codes) - 1) ** 0.5
            varies = std > 1e-6 * std.max().clamp_min(1e-12)
            directions = directions[varies]
            std = std[varies]
            largest = directions.gather(1, directions.abs().argmax(1, keepdim=True))
            return cls(mean, directions * largest.sign(), std)

    @classmethod
    def identity(cls, latent: int) -> "CodeSpace":
        """Return the space whose coordinates are the code's own numbers."""
        return cls(torch.zeros(latent), torch.eye(latent), torch.ones(latent))

    def coordinates(self, code: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch rank"]:
        """Return a code's coordinates: standard deviations along the principal directions."""
        return (code - self.mean) @ self.directions.T / self.std

    def code(self, coordinates: Float[Tensor, "*batch count"]) -> Float[Tensor, "*batch latent"]:
        """Return the code at these coordinates (standard deviations); directions left out count as zero."""
        return self.mean + coordinates @ self.basis[: coordinates.shape[-1]]

    @property
    def basis(self) -> Float[Tensor, "rank latent"]:
        """Change of a code per standard deviation of each coordinate."""
        return self.std[:, None] * self.directions

    def distance(
        self, code: Float[Tensor, "*batch latent"], start: Float[Tensor, "*#batch latent"] | None = None
    ) -> Float[Tensor, "*batch"]:
        """Return the RMS difference of coordinates between a code and ``start``, in standard deviations.

        ``start`` is the mean by default; the mean square distance of the trained codes from it is 1.
        """
        return self.coordinates(code if start is None else code - start + self.mean).square().mean(-1).sqrt()


class Entry(NamedTuple):
    """An object of a code book: its name and the rows of its shape and texture code."""

    name: str
    shape: int
    texture: int


@dataclass(frozen=True, eq=False)
class CodeBook:
    """The codes of a trained model. Objects may share a shape or a texture, so each kind has its own rows."""

    shapes: Float[Tensor, "shapes shape_latent"]
    textures: Float[Tensor, "textures texture_latent"]
    objects: tuple[Entry, ...]
    collapsed: frozenset[int] = frozenset()
    """Objects that collapsed in training and show next to nothing: still indexed, but not part of the code spaces."""

    def __post_init__(self) -> None:
        if not bool(torch.isfinite(self.shapes).all() and torch.isfinite(self.textures).all()):
            raise ValueError("codes must be finite")
        if not self.collapsed <= set(range(len(self.objects))):
            raise ValueError(f"collapsed objects {sorted(self.collapsed)} of a book of {len(self.objects)}")
        for entry in self.objects:
            if not (0 <= entry.shape < len(self.shapes) and 0 <= entry.texture < len(self.textures)):
                raise ValueError(f"object {entry.name} has codes outside the book")

    def __len__(self) -> int:
        return len(self.objects)

    def __getitem__(self, index: int) -> Codes:
        """Return the codes of an object. Raises ``ValueError`` for an index outside the book."""
        if not 0 <= index < len(self.objects):
            raise ValueError(f"object must be 0 to {len(self.objects) - 1}, got {index}")
        entry = self.objects[index]
        return Codes(self.shapes[entry.shape], self.textures[entry.texture])

    @cached_property
    def index(self) -> dict[str, int]:
        """Index of every object by name."""
        return {entry.name: index for index, entry in enumerate(self.objects)}

    @cached_property
    def valid(self) -> tuple[int, ...]:
        """Indices of the objects that are not collapsed."""
        return tuple(index for index in range(len(self.objects)) if index not in self.collapsed)

    @cached_property
    def shape_space(self) -> CodeSpace:
        """Distribution of the shape codes."""
        return CodeSpace.from_codes(self._valid_rows(self.shapes, [entry.shape for entry in self.objects]))

    @cached_property
    def texture_space(self) -> CodeSpace:
        """Distribution of the texture codes."""
        return CodeSpace.from_codes(self._valid_rows(self.textures, [entry.texture for entry in self.objects]))

    @property
    def mean(self) -> Codes:
        """The mean shape with the mean texture, where the paper's fit begins."""
        return Codes(self.shape_space.mean, self.texture_space.mean)

    def sample(self, generator: torch.Generator) -> Codes:
        """Sample a pair of codes from normal distributions with the mean and variance of the two code spaces."""
        shape, texture = (
            space.code(torch.randn(len(space.std), generator=generator))
            for space in (self.shape_space, self.texture_space)
        )
        return Codes(shape, texture)

    def _valid_rows(self, codes: Float[Tensor, "rows latent"], rows: list[int]) -> Float[Tensor, "kept latent"]:
        """Return the rows except those used by collapsed objects alone."""
        lost = {rows[index] for index in self.collapsed} - {rows[index] for index in self.valid}
        return codes[[row for row in range(len(codes)) if row not in lost]] if lost else codes


def farthest_first(points: Float[Tensor, "points size"]) -> list[int]:
    """Return an order of points in which each is farthest from all before it; the first stays first (Gonzalez 1985)."""
    if not len(points):
        return []
    order = [0]
    distance = (points - points[0]).norm(dim=1)  # to the nearest point of the order
    while len(order) < len(points):
        distance[order[-1]] = -1.0  # equal points, too, come only once
        order.append(int(distance.argmax()))
        distance = torch.minimum(distance, (points - points[order[-1]]).norm(dim=1))
    return order
