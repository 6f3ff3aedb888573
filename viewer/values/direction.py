"""Straight directions in code space, moved along by sliders: principal ones, or from one object to another."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from core.models.codes import CodeBook, Codes
from viewer.values.part import PARTS, Part


@dataclass(frozen=True)
class Direction:
    """A direction in shape, texture, or both, by equally many standard deviations of the trained codes."""

    name: str
    step: Codes  # one standard deviation; zero in a code that does not change

    @classmethod
    def principal(cls, book: CodeBook, part: Part, index: int) -> "Direction":
        """Return one of the principal directions of the trained codes, named by its number."""
        space = book.shape_space if part == "shape" else book.texture_space
        zero, way = _zero(book), space.basis[index]
        return cls(str(index + 1), replace(zero, shape=way) if part == "shape" else replace(zero, texture=way))

    @classmethod
    def between(cls, name: str, book: CodeBook, ends: tuple[Codes, Codes], parts: Iterable[Part]) -> "Direction":
        """Return the direction from one object's shape, texture, or both to another's.

        Raises ``ValueError`` if they do not differ.
        """
        first, second = ends
        spaces = {"shape": book.shape_space, "texture": book.texture_space}
        steps = {part: spaces[part].one_deviation(getattr(second, part) - getattr(first, part)) for part in parts}
        zero = _zero(book)
        step = replace(zero, shape=steps.get("shape", zero.shape), texture=steps.get("texture", zero.texture))
        found = cls(name, step)
        if not found.parts:
            raise ValueError(f"both have the same {' and '.join(parts)}")
        return found

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The codes that it changes."""
        return tuple(part for part in PARTS if bool(getattr(self.step, part).any()))

    def strength(self, codes: Codes, mean: Codes) -> float:
        """Return the position of codes along the direction, in standard deviations from the mean, averaged over both
        parts.
        """
        ways = ((getattr(codes, part) - getattr(mean, part), getattr(self.step, part)) for part in self.parts)
        return sum(float(way @ step / step.square().sum()) for way, step in ways) / len(self.parts)

    def moved(self, codes: Codes, mean: Codes, to: float) -> Codes:
        """Return the codes at another position; components across the direction stay."""
        by = to - self.strength(codes, mean)
        return replace(codes, **{part: getattr(codes, part) + by * getattr(self.step, part) for part in self.parts})


def _zero(book: CodeBook) -> Codes:
    mean = book.mean
    return replace(mean, shape=torch.zeros_like(mean.shape), texture=torch.zeros_like(mean.texture))
