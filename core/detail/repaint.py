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

_OTHER_HUE = 0.16, 0.06  # chroma across the paint's, over lightness: another hue up to the first, paint from the second
_DULL = 0.15, 0.5  # chroma along the paint's, over that in this light, likewise
_VIVID = 3.0, 2.0
_SHADE = 0.35, 0.6  # lightness over the paint's, likewise, of glass and trim; chroma along the paint's confirms it
_BRIGHT = 2.4, 1.7  # of lettering
_GREYISH = 0.05  # chroma added to both of a ratio
_LIGHTEST = 1.6  # largest light on paint
_OTHER_PAINT = 0.5  # difference of renders from which the new paint replaces the old one completely
_GREY = 0.1  # weight of lightness against chroma, which white light does not change
_BLACK = 0.05  # lightness of the darkest paint
_RIDGE = 0.03  # relative weight of unchanged colours: a car of one colour says little about others
_ROBUST = 0.15  # scale of the residuals' Cauchy weights


def repainted(
    photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"], change: Float[Tensor, "3 *#places"]
) -> Float[Tensor, "3 *places"]:
    """Return the photo with another paint in its light, as if it were paint everywhere.

    Args:
        paint: its colour in even light, as in the photo.
        change: of that colour.
    """
    return photo + light_share(photo, paint) * change


def lit_paint(
    photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"], amount: Float[Tensor, "*places"]
) -> Float[Tensor, "*places"]:
    """Return the fraction of a change of paint that an image's colours take, 0..1.6.

    Args:
        paint: its colour in even light.
        amount: 0..1, how much paint places have at most.
    """
    return amount * same_paint(photo, paint) * light_share(photo, paint)


def light_share(photo: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return the amount of a paint in a photo, 0..1.6: below 1 in shade, above 1 in bright light."""
    vivid = chroma(paint)
    even = lightness(paint).clamp_min(_BLACK)
    held = (chroma(photo) * vivid).sum(0) + _GREY * lightness(photo) * even
    return (held / (vivid.square().sum(0) + _GREY * even**2)).clamp(0, _LIGHTEST)


def same_paint(colours: Float[Tensor, "3 *places"], paint: Float[Tensor, "3 *#places"]) -> Float[Tensor, "*places"]:
    """Return the similarity of colours to a paint in another light, 0..1."""
    light = lightness(colours) / lightness(paint).clamp_min(_BLACK)
    vivid = chroma(paint)
    length = vivid.norm(dim=0).clamp_min(1e-6)
    parallel = (chroma(colours) * vivid).sum(0) / length
    perpendicular = (chroma(colours) - parallel * vivid / length).norm(dim=0) / (0.3 + 0.7 * lightness(colours))
    ratio = (parallel + _GREYISH) / (light * length + _GREYISH)
    hue = smooth_step(perpendicular, *_OTHER_HUE) * smooth_step(ratio, *_DULL) * smooth_step(ratio, *_VIVID)
    return hue * smooth_step(light + 2 * parallel, *_SHADE) * smooth_step(light, *_BRIGHT)


def chroma(colours: Float[Tensor, "3 *places"]) -> Float[Tensor, "3 *places"]:
    """Return the colours minus their lightness."""
    return colours - lightness(colours)


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
