"""The names of colours."""

import math

import numpy as np

from core.edits.paint import Rgb

_HUES = {20: "pink", 40: "red", 72: "orange", 112: "yellow", 165: "green", 215: "turquoise", 282: "blue", 335: "purple"}
"""Hues by their upper limits, degrees in Oklab; beyond the last one is pink again."""
_GREYS = {0.28: "black", 0.48: "dark grey", 0.7: "grey", 0.84: "light grey"}  # by upper lightness; lighter ones: white
_GREY = 0.025  # chroma below which a colour is a grey
_DARK, _LIGHT = 0.42, 0.78  # lightness below and above which a colour is called dark or light


def colour_word(colour: Rgb) -> str:
    """Return the name of an sRGB colour, 0..1.

    >>> colour_word((0.76, 0.13, 0.16)), colour_word((0.12, 0.27, 0.2)), colour_word((0.8, 0.73, 0.61))
    ('red', 'dark green', 'beige')
    """
    lightness, first, second = _oklab(colour)
    chroma = math.hypot(first, second)
    hue = math.degrees(math.atan2(second, first)) % 360
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
    if lightness < _DARK:
        return f"dark {word}"
    return f"light {word}" if lightness > _LIGHT + 0.1 * (word == "yellow") else word


def _oklab(colour: Rgb) -> tuple[float, float, float]:
    channels = np.array(colour)
    linear = np.where(channels > 0.04045, ((channels + 0.055) / 1.055) ** 2.4, channels / 12.92)
    cones = np.cbrt(linear @ np.array([[0.4122, 0.2119, 0.0883], [0.5363, 0.6807, 0.2817], [0.0514, 0.1074, 0.6300]]))
    lab = cones @ np.array([[0.2105, 1.9780, 0.0259], [0.7936, -2.4286, 0.7828], [-0.0041, 0.4506, -0.8087]])
    return tuple(lab.tolist())
