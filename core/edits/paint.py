"""Paints of an object's parts: exact changes of its colours, which no texture code can express.

A code finds the colour of one part only together with others'. Therefore a paint keeps the code and maps the network's
colour of each point to another one: the paint under the light that the network shows there, by the point's membership
of the part.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from core.edits.edit import Edit
from core.geometry.pixels import lightness

Rgb = tuple[float, float, float]
MATERIALS = {"fabric": "seat", "wood": "legs"}  # of chairs, by the part that surely has it; metal legs count as wood
UNPAINTED = "wheels", "glass", "lamps"  # of cars, which neither a texture nor a paint of the body changes in photos
_DARKEST, _LIGHTEST = 0.3, 1.2  # light on a point, relative to the mean of its part
_ANOTHER = 0.25  # colour difference from which a part becomes evenly coloured; below, its pattern stays
_LEAST_DISTANCE = 1e-3  # of the two materials' colours
_CERTAIN = 3.0  # exponent of a part's probability: a doubtful place takes hardly any paint
_SHARP = 2.0  # change of a material's membership over the difference between the two materials' colours


@dataclass(frozen=True)
class PartPaint(Edit):
    """A paint on a part. Raises ``ValueError`` for numbers out of range."""

    part: str  # a part's name or one of :data:`MATERIALS`; '' is the whole object
    colour: Rgb  # sRGB 0..1, mean of the part's lighter half
    before: Rgb  # the same in the network's colours
    materials: tuple[Rgb, Rgb] | None = None
    """the network's colours of a material and of the opposite one; None: the part alone tells where the paint is"""
    share: float = 1.0  # 0..1, of the paint in a mix of objects

    key = "paints"
    subject = "texture"
    most = 16

    def __post_init__(self) -> None:
        channels = itertools.chain(self.colour, self.before, *(self.materials or ()))
        if not all(0 <= number <= 1 for number in (*channels, self.share)):  # also for NaN
            raise ValueError(f"a paint's channels and its share are 0 to 1, got {self}")
        if self.materials and math.dist(*self.materials) < _LEAST_DISTANCE:
            raise ValueError("materials of one colour cannot be distinguished")

    def membership(
        self, colours: Float[Tensor, "*places 3"], parts: Mapping[str, Float[Tensor, "*places"]]
    ) -> Float[Tensor, "*places"]:
        """Return each place's membership of the part, 0..1; 0 if the model lacks the part."""
        if self.materials:
            material, opposite = (colours.new_tensor(colour) for colour in self.materials)
            nearer = (colours - opposite).norm(dim=-1) - (colours - material).norm(dim=-1)
            return (0.5 + _SHARP * nearer / math.dist(*self.materials)).clamp(0, 1)
        if self.part == "":
            return torch.ones_like(colours[..., 0])
        legs = parts.get("legs", torch.zeros_like(colours[..., 0]))
        materials = {"fabric": 1 - legs, "wood": legs} if "legs" in parts else {}  # of one colour
        fraction = {**materials, **parts}.get(self.part, torch.zeros_like(legs)).clamp(0, 1)
        return _certain(fraction)

    def membership_in_photo(self, shares: Mapping[str, Float[Tensor, "*places"]]) -> Float[Tensor, "*places"]:
        """Return the share of the part's paint in a photo's pixels, from those of all parts and materials."""
        fraction = shares.get(self.part)
        return torch.zeros_like(next(iter(shares.values()))) if fraction is None else _certain(fraction.clamp(0, 1))

    def over(
        self,
        colours: Float[Tensor, "*places 3"],
        below: Float[Tensor, "*places 3"],
        parts: Mapping[str, Float[Tensor, "*places"]],
    ) -> Float[Tensor, "*places 3"]:
        """Return colours with the paint; see :class:`core.edits.edit.Edit`."""
        colour, unpainted = (colours.new_tensor(value) for value in (self.colour, self.before))
        light = lightness(colours.movedim(-1, 0)) / lightness(unpainted).clamp_min(0.05)
        evenly = colour * light.clamp(_DARKEST, _LIGHTEST).sqrt()[..., None]
        even = ((colour - unpainted).norm() / _ANOTHER).clamp_max(1)
        painted = torch.lerp(colours + (colour - unpainted), evenly, even).clamp(0, 1)
        return torch.lerp(below, painted, (self.share * self.membership(colours, parts))[..., None])

    @classmethod
    def mixed(
        cls, first: tuple["PartPaint", ...], second: tuple["PartPaint", ...], amount: float
    ) -> tuple["PartPaint", ...]:
        """Return the paints between two objects: the second's cover the first's by ``amount``, 0..1.

        A part painted in both objects passes from one paint to the other and shows no colour of the network between.
        """
        if amount <= 0 or amount >= 1 or first == second:
            return second if amount >= 1 else first
        above = [replace(paint, share=amount * paint.share) for paint in second]
        covered = {paint.part: paint.share for paint in above}
        below = (
            replace(paint, share=min(1.0, (1 - amount) * paint.share / (1 - covered.get(paint.part, 0.0))))
            for paint in first
        )
        return (*below, *above)[-PartPaint.most :]


def as_rgb(colour: Float[Tensor, "3"]) -> Rgb:
    """Return a colour as numbers, limited to 0..1."""
    red, green, blue = (round(channel, 5) for channel in colour.clamp(0, 1).tolist())
    return red, green, blue


def _certain(fraction: Float[Tensor, "*places"]) -> Float[Tensor, "*places"]:
    """Return a probability nearer to 0 or 1."""
    return fraction**_CERTAIN / (fraction**_CERTAIN + (1 - fraction) ** _CERTAIN)
