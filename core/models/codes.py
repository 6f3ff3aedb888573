"""Shape and texture codes: a pair for an object, the book of a trained model, and the space its codes span."""

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits.bend import Bend, mixed_bend
from core.edits.paint import MAX_PAINTS, PartPaint, mixed_paints
from core.edits.warp import Warp, mixed_warp
from core.geometry.camera import Factors
from core.models.latents import CODE_KINDS, CodeKind, Latents, mixed_offsets
from core.models.photo_detail import PhotoDetail

__all__ = ["CODE_KINDS", "CodeBook", "CodeKind", "CodeSpace", "Codes", "Entry", "farthest_first"]


STRETCH = 0.01, 100.0  # least and largest stretch of a side
MAX_DISTORTION = 10.0  # largest stretch of a side relative to that of another one
_ROUNDING = 1 + 1e-6  # factor by which a stretch, computed from ones at their limits, may exceed these


@dataclass(frozen=True, eq=False)
class Codes(Latents):
    """The latent numbers of an object of a model, with the photos of a fitted object, and its size.

    Raises ``ValueError`` for a stretch out of range.
    """

    detail: PhotoDetail | None = None
    """Photos of a fitted object. They follow the shape when codes are combined; a new texture paints over them."""
    stretch: Factors | None = None
    """Sides relative to the natural ones (:mod:`core.editing.size`); None: natural. They follow the shape, too."""
    warp: Warp | None = None
    """The map of an edited object to the one that it was made from (:mod:`core.models.motion`); None: not edited."""
    bend: Bend | None = None
    """Legs or roof relative to the natural ones (:mod:`core.editing.size`); it comes before the stretch."""
    paints: tuple[PartPaint, ...] = ()
    """Of the parts, the last one uppermost. They belong to the texture; a photo takes them, too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.paints) > MAX_PAINTS:
            raise ValueError(f"an object has at most {MAX_PAINTS} paints, got {len(self.paints)}")
        if self.bend and self.bend.moved == self.bend.plane:
            object.__setattr__(self, "bend", None)
        if self.stretch is None:
            return
        low, high = STRETCH
        within = all(low / _ROUNDING <= factor <= high * _ROUNDING for factor in self.stretch)
        if len(self.stretch) != 3 or not within:
            raise ValueError(f"a side is {low:g} to {high:g} times its natural one, got {self.stretch}")
        if max(self.stretch) > _ROUNDING * MAX_DISTORTION * min(self.stretch):
            raise ValueError(f"a side is stretched at most {MAX_DISTORTION:g} times as much as another one")
        if self.stretch == (1.0, 1.0, 1.0):
            object.__setattr__(self, "stretch", None)

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, Codes):
            return NotImplemented
        same_detail = self.detail is value.detail or self.detail == value.detail
        return super().__eq__(value) and self.stretch == value.stretch and same_detail

    __hash__ = Latents.__hash__

    @property
    def shape_key(self) -> tuple[float, ...]:
        """All numbers of the shape, of its warp and of its bend, as a comparable key."""
        warp = (math.inf, *self.warp.numbers) if self.warp else ()
        bend = (-math.inf, *vars(self.bend).values()) if self.bend else ()
        return super().shape_key + warp + bend

    @property
    def texture_key(self) -> tuple[Hashable, ...]:
        """All numbers of the texture, and the paints, as a comparable key."""
        return super().texture_key + self.paints

    @property
    def is_sized(self) -> bool:
        """True if the object has another size than its natural one, or other proportions."""
        return not (self.stretch is None and self.bend is None)

    @property
    def factors(self) -> Factors:
        """The stretch along each axis, 1 for none."""
        return self.stretch or (1.0, 1.0, 1.0)

    @property
    def scale(self) -> float:
        """The part of the stretch that images do not show: its root mean square."""
        return 1.0 if self.stretch is None else math.sqrt(sum(factor**2 for factor in self.stretch) / 3)

    @property
    def proportions(self) -> Factors | None:
        """The stretch in images: that without its scale. None if no side changes relative to the others."""
        if self.stretch is None or len(set(self.stretch)) == 1:
            return None
        x, y, z = (factor / self.scale for factor in self.stretch)
        return x, y, z

    def with_latents(self, tensors: Mapping[str, Tensor]) -> "Codes":
        """Return these codes with other numbers, by field of :class:`core.models.latents.Latents`."""
        return replace(self, **tensors)  # type: ignore[arg-type]

    @classmethod
    def of(cls, latents: Latents) -> "Codes":
        """Return latents as codes without photo detail."""
        return cls(latents.shape, latents.texture, latents.shape_offsets, latents.texture_offsets)

    def mixed(self, second: "Codes", shape: float, texture: float) -> "Codes":
        """Interpolate linearly between two objects' codes, offsets and sizes.

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
            mixed_stretch(self.stretch, second.stretch, shape),
            mixed_warp(self.warp, second.warp, shape),
            mixed_bend(self.bend, second.bend, shape),
            mixed_paints(self.paints, second.paints, texture),
        )

    def taking(self, kind: CodeKind, source: "Codes") -> "Codes":
        """Return these codes with the shape or the texture of another object, offsets included.

        A shape comes with its photo detail and its size, a texture with its paints.
        """
        names = {
            "shape": ("shape", "shape_offsets", "detail", "stretch", "warp", "bend"),
            "texture": ("texture", "texture_offsets", "paints"),
        }[kind]
        return replace(self, **{name: getattr(source, name) for name in names})


def mixed_stretch(first: Factors | None, second: Factors | None, amount: float) -> Factors | None:
    """Interpolate linearly; None stands for ones."""
    if first == second:
        return first
    ends = zip(first or (1.0, 1.0, 1.0), second or (1.0, 1.0, 1.0), strict=True)
    x, y, z = ((1 - amount) * start + amount * end for start, end in ends)
    return x, y, z


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
        with torch.inference_mode(False), torch.no_grad():
            mean = codes.mean(0)
            _, singular, directions = torch.linalg.svd(codes - mean, full_matrices=False)
            std = singular / max(1, len(codes) - 1) ** 0.5
            kept = std > 1e-6 * std.max().clamp_min(1e-12)
            directions = directions[kept]
            std = std[kept]
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

    @property
    def first_name(self) -> str:
        """Name of the first object that did not collapse; "mean" if there are none."""
        return self.objects[self.valid[0]].name if self.valid else "mean"

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
