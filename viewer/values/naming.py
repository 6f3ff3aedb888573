"""Words for an object, measured in its image: the colour of its paint, and whether it is low or tall."""

import numpy as np
from jaxtyping import Float, UInt8

Image = tuple[UInt8[np.ndarray, "height width 3"], Float[np.ndarray, "height width"]]  # with its opacity

_HUES = {20: "pink", 40: "red", 72: "orange", 112: "yellow", 165: "green", 215: "turquoise", 282: "blue", 335: "purple"}
"""Hues by their upper limits, degrees in Oklab; beyond the last one is pink again."""
_GREYS = {0.28: "black", 0.48: "dark grey", 0.7: "grey", 0.84: "light grey"}  # by upper lightness; lighter ones: white
_GREY = 0.025  # chroma below which a colour is a grey
_DARK, _LIGHT = 0.42, 0.78  # lightness below and above which a colour is called dark or light
_BLACK = 0.5  # weight of black pixels: windows, tyres and gaps
_NEW = 0.06  # least growth of a colour's fraction of the object that counts as another paint
_OPAQUE = 0.9  # least opacity of a pixel that shows the object alone
_HEIGHTS = {"chairs": (1.1, 1.9), "cars": (0.69, 0.81)}
"""Height over width of thumbnails: a tenth of the training objects is below the first number, low, or above, tall."""


def colour_word(image: UInt8[np.ndarray, "height width 3"], opacity: Float[np.ndarray, "height width"]) -> str:
    """Return the name of an object's most frequent colour; "" without an opaque pixel."""
    colours, shares = _palette(image, opacity)
    return _named(colours[int(shares.argmax())]) if colours else ""


def new_colour_word(before: Image, after: Image) -> str:
    """Return the name of the colour that an object has more of than before; "" if no colour is new.

    A colour counts by its growth and by how unlike the former ones it is: paint of a part tints the others a little.
    """
    former, former_shares = _palette(*before)
    colours, shares = _palette(*after)
    growth = {kind: shares[kind] - former_shares[kind] for kind in colours}
    noticed = {
        kind: growth[kind] * min(float(np.linalg.norm(colour - old)) for old in former.values())
        for kind, colour in colours.items()
        if former and growth[kind] > _NEW
    }
    return _named(colours[max(noticed, key=lambda kind: noticed[kind])]) if noticed else ""


def _palette(
    image: UInt8[np.ndarray, "height width 3"], opacity: Float[np.ndarray, "height width"]
) -> tuple[dict[int, Float[np.ndarray, "3"]], Float[np.ndarray, "kinds"]]:
    """Return the object's colours in Oklab, a grey or a hue each, and the fraction of every kind; black counts less."""
    pixels = _oklab(image[opacity > _OPAQUE] / 255.0)
    greys = np.searchsorted([*_GREYS], pixels[:, 0])
    hues = np.searchsorted([*_HUES], _hue(pixels)) % len(_HUES)
    kinds = np.where(_chroma(pixels) < _GREY, greys, len(_GREYS) + 1 + hues)
    shares = np.bincount(kinds, minlength=len(_GREYS) + 1 + len(_HUES)) / max(1, len(kinds))
    shares[0] *= _BLACK
    return {int(kind): np.median(pixels[kinds == kind], axis=0) for kind in np.flatnonzero(shares)}, shares


def _named(colour: Float[np.ndarray, "3"]) -> str:
    """Return the name of a colour in Oklab."""
    lightness = float(colour[0])
    chroma = float(_chroma(colour))
    hue = float(_hue(colour))
    if chroma < _GREY:
        return next((word for limit, word in _GREYS.items() if lightness < limit), "white")
    word = next((word for limit, word in _HUES.items() if hue <= limit), "pink")
    if word in ("orange", "yellow") and chroma < 0.13:
        dark = "brown" if hue < 95 else "dark green"
        return "beige" if lightness > 0.68 else dark
    if word == "red" and lightness > 0.6 and chroma < 0.1:
        return "pink"
    if word == "pink" and lightness < _DARK:
        return "dark red"
    return (
        f"dark {word}"
        if lightness < _DARK
        else f"light {word}"
        if lightness > _LIGHT + 0.1 * (word == "yellow")
        else word
    )


def height_word(opacity: Float[np.ndarray, "height width"], category: str) -> str:
    """Return "low" or "tall", compared with objects of the category, or "" for neither.

    Args:
        opacity: 0..1, of the object's thumbnail.
    """
    opaque = opacity > 0.5
    low, high = _HEIGHTS.get(category, (0.0, np.inf))
    ratio = opaque.any(1).sum() / max(1, opaque.any(0).sum())
    return "low" if 0 < ratio < low else "tall" if ratio > high else ""


def _oklab(colours: Float[np.ndarray, "colours 3"]) -> Float[np.ndarray, "colours 3"]:
    """Return sRGB colours, 0..1, in Oklab."""
    linear = np.where(colours > 0.04045, ((colours + 0.055) / 1.055) ** 2.4, colours / 12.92)
    cones = np.cbrt(linear @ np.array([[0.4122, 0.2119, 0.0883], [0.5363, 0.6807, 0.2817], [0.0514, 0.1074, 0.6300]]))
    return cones @ np.array([[0.2105, 1.9780, 0.0259], [0.7936, -2.4286, 0.7828], [-0.0041, 0.4506, -0.8087]])


def _chroma(colours: Float[np.ndarray, "*colours 3"]) -> Float[np.ndarray, "*colours"]:
    return np.hypot(colours[..., 1], colours[..., 2])


def _hue(colours: Float[np.ndarray, "*colours 3"]) -> Float[np.ndarray, "*colours"]:
    """Return hues in degrees, 0..360."""
    return np.degrees(np.arctan2(colours[..., 2], colours[..., 1])) % 360
