"""A photo in another paint: what the paint covers changes with the texture, everything else stays the photo's.

A pixel of the photo is a share of paint, as light as the photo has it, and a remainder: lettering, dirt, a reflection.
A new texture moves the paint from the render of the fitted codes to the render of the new ones; the remainder stays.
Whatever has another colour than the paint, or a part that is never painted, keeps the photo's colour.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.rendering.detail_maps import ColourMatch, smooth_step

_LIGHTNESS = 0.299, 0.587, 0.114
_OTHER_HUE = (
    0.06,
    0.16,
)  # difference of chroma over lightness: up to the first it is the paint, from the second it is not
_LIGHTER = 1.6  # times the render's lightness: the most that light explains
_LETTERING = 0.08, 0.25  # lightness above that: up to the first a highlight on the paint, from the second lettering
_OTHER_PAINT = 0.5  # difference of renders from which on the new paint replaces the old one completely
_GREY = 0.1  # weight of lightness against chroma, which white light over the paint leaves alone
_BLACK = 0.05  # lightness that the darkest paint counts as
_RIDGE = 0.03  # of all weights, for the colours as they are: a car of one colour says little about others
_ROBUST = 0.15  # scale of the residuals' Cauchy weights


def lightness(colours: Float[Tensor, "3 *places"]) -> Float[Tensor, "*places"]:
    """Return the luma (Rec. 601) of sRGB colours."""
    red, green, blue = colours
    return _LIGHTNESS[0] * red + _LIGHTNESS[1] * green + _LIGHTNESS[2] * blue


class Coat(NamedTuple):
    """A paint that a photo shows, and how it changes."""

    colour: Float[Tensor, "3 *#places"]  # in even light, as the photo has it
    change: Float[Tensor, "3 *#places"]  # of that colour
    amount: Float[Tensor, "*places"]  # 0..1, how far places take paint at all


def repainted(photo: Float[Tensor, "3 *places"], coats: Sequence[Coat]) -> Float[Tensor, "3 *places"]:
    """Return the photo with its paint changed; each coat covers what those before it leave."""
    left = torch.ones_like(photo[0])
    for colour, change, amount in coats:
        covered, share = (
            left * amount * same_hue(photo, colour) * _no_lettering(photo, colour),
            light_share(photo, colour),
        )
        photo, left = photo + covered * share * change, left - covered
    return photo


def light_share(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return how much of a paint a photo holds, 0..1.6: less in shade, and whatever white light lies over it."""
    vivid, even = chroma(paint), lightness(paint).clamp_min(_BLACK)
    held = (chroma(photo) * vivid).sum(0) + _GREY * lightness(photo) * even
    return (held / (vivid.square().sum(0) + _GREY * even**2)).clamp(0, _LIGHTER)


def same_hue(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return how far a photo has the hue of a paint, in whatever light: 0..1."""
    difference = (chroma(photo) - light_share(photo, paint) * chroma(paint)).abs().amax(0)
    return smooth_step(difference / (0.3 + 0.7 * lightness(photo)), *reversed(_OTHER_HUE))


def chroma(colours: Float[Tensor, "3 *places"]) -> Float[Tensor, "3 *places"]:
    """Return the colours less their lightness."""
    return colours - lightness(colours)


def _no_lettering(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """0 where the photo is lighter than light on the paint explains, as white lettering on dark paint is."""
    above = lightness(photo) - _LIGHTER * lightness(paint).clamp_min(_BLACK)
    return smooth_step(above, *reversed(_LETTERING))


def moved_paint(change: Float[Tensor, "3 *places"], offset: Float[Tensor, "3 *places"]) -> Float[Tensor, "3 *places"]:
    """Return the change of a photo's paint from that of the render.

    Args:
        offset: the photo's paint less the render's. A small change keeps it, another paint leaves it behind.
    """
    return change - replaced_share(change.movedim(0, -1)) * offset


def replaced_share(change: Float[Tensor, "*places 3"]) -> Float[Tensor, "*places"]:
    """Return how far a change of colour is another paint, not a shade of the same: 0..1."""
    return (change.abs().amax(-1) / _OTHER_PAINT).clamp_max(1)


def colour_match(
    colours: Float[Tensor, "3 places"], photo: Float[Tensor, "3 places"], weight: Float[Tensor, "places"]
) -> ColourMatch:
    """Fit gain and offset of each channel by robust least squares; without weight, the colours as they are."""
    gain, offset = list[float](), list[float]()
    for own, seen in zip(colours.double(), photo.double(), strict=True):
        scale, shift, ridge = 1.0, 0.0, _RIDGE * float(weight.sum()) + 1e-6
        for _ in range(3):
            robust = weight / (1 + ((seen - scale * own - shift) / _ROBUST) ** 2)
            rows = torch.stack((own, torch.ones_like(own)))
            normal = (rows * robust) @ rows.T + ridge * torch.eye(2, dtype=torch.float64)
            scale, shift = torch.linalg.solve(normal, (rows * robust) @ seen + torch.tensor([ridge, 0.0])).tolist()
        gain.append(scale)
        offset.append(shift)
    return ColourMatch((gain[0], gain[1], gain[2]), (offset[0], offset[1], offset[2]))
