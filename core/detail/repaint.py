"""Repaint a photo: painted areas change with the texture, everything else keeps the photo's colour.

A pixel of the photo is paint in the photo's light, plus a remainder: lettering, dirt, a reflection. A new texture moves
the paint from the render of the fitted codes to the render of the new ones; the remainder stays. Pixels of another
colour than the paint, and parts that are never painted, keep their colour.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from core.detail.lookup import ColourMatch, smooth_step
from core.geometry.pixels import lightness

_OTHER_HUE = 0.06, 0.16  # difference of chroma over lightness: paint up to the first, not paint from the second
_LIGHTER = 1.6  # largest ratio to the render's lightness that light explains
_LETTERING = 0.08, 0.25  # lightness above that: a highlight up to the first, lettering from the second
_OTHER_PAINT = 0.5  # difference of renders from which the new paint replaces the old one completely
_GREY = 0.1  # weight of lightness against chroma, which white light does not change
_BLACK = 0.05  # lightness of the darkest paint
_RIDGE = 0.03  # relative weight of unchanged colours: a car of one colour says little about others
_ROBUST = 0.15  # scale of the residuals' Cauchy weights


def repainted(
    photo: Float[Tensor, "3 *places"],
    paint: Float[Tensor, "3 *#places"],
    change: Float[Tensor, "3 *#places"],
    amount: Float[Tensor, "*places"],
) -> Float[Tensor, "3 *places"]:
    """Return the photo with its paint changed.

    Args:
        paint: its colour in even light, as in the photo.
        change: of that colour.
        amount: 0..1, how much paint places have at most.
    """
    return photo + lit_paint(photo, paint, amount) * change


def lit_paint(
    photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"], amount: Float[Tensor, "*places"]
) -> Float[Tensor, "*places"]:
    """Return the fraction of a change of paint that a photo's colours take, 0..1.6; arguments as :func:`repainted`."""
    return amount * same_hue(photo, paint) * _no_lettering(photo, paint) * light_share(photo, paint)


def light_share(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return the amount of a paint in a photo, 0..1.6: below 1 in shade, above 1 in bright light."""
    vivid = chroma(paint)
    even = lightness(paint).clamp_min(_BLACK)
    held = (chroma(photo) * vivid).sum(0) + _GREY * lightness(photo) * even
    return (held / (vivid.square().sum(0) + _GREY * even**2)).clamp(0, _LIGHTER)


def same_hue(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return the similarity of a photo's hue to a paint's in any light, 0..1."""
    difference = (chroma(photo) - light_share(photo, paint) * chroma(paint)).abs().amax(0)
    return smooth_step(difference / (0.3 + 0.7 * lightness(photo)), *reversed(_OTHER_HUE))


def chroma(colours: Float[Tensor, "3 *places"]) -> Float[Tensor, "3 *places"]:
    """Return the colours minus their lightness."""
    return colours - lightness(colours)


def _no_lettering(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return 0 for pixels lighter than light on the paint explains, such as white lettering on dark paint."""
    above = lightness(photo) - _LIGHTER * lightness(paint).clamp_min(_BLACK)
    return smooth_step(above, *reversed(_LETTERING))


def moved_paint(change: Float[Tensor, "3 *places"], offset: Float[Tensor, "3 *places"]) -> Float[Tensor, "3 *places"]:
    """Return the change of a photo's paint, given the change of the render.

    Args:
        offset: photo's paint minus render's. A small change keeps this offset, a different paint discards it.
    """
    return change - replaced_share(change.movedim(0, -1)) * offset


def replaced_share(change: Float[Tensor, "*places 3"]) -> Float[Tensor, "*places"]:
    """Return how much a change of colour is a different paint rather than a shade, 0..1."""
    return (change.abs().amax(-1) / _OTHER_PAINT).clamp_max(1)


def colour_match(
    colours: Float[Tensor, "3 places"], photo: Float[Tensor, "3 places"], weight: Float[Tensor, "places"]
) -> ColourMatch:
    """Fit gain and offset of each channel by robust least squares; identity without weight."""
    rows = torch.stack((colours, torch.ones_like(colours)), 1).double()
    target = photo.double()
    ridge = _RIDGE * float(weight.sum()) + 1e-6
    identity = torch.tensor([1.0, 0.0], dtype=torch.float64)
    match = identity.expand(3, 2)  # gain and offset
    for _ in range(3):
        residuals = target - (match[..., None] * rows).sum(1)
        weighted = rows * (weight / (1 + (residuals / _ROBUST) ** 2))[:, None]
        normal = weighted @ rows.mT + ridge * torch.eye(2, dtype=torch.float64)
        match = torch.linalg.solve(normal, (weighted @ target[..., None])[..., 0] + ridge * identity)
    (red, green, blue), offset = match.T.tolist()
    return ColourMatch((red, green, blue), (offset[0], offset[1], offset[2]))
