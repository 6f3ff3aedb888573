"""Paints to choose from: twelve for a part, and all hues in all lightnesses."""

import colorsys
import re

from core.edits.paint import Rgb

_CAR = {
    "White": "#f2f2ee", "Silver": "#b9bdc1", "Grey": "#6d7277", "Black": "#1b1c1f",
    "Red": "#c3202a", "Dark red": "#6f1520", "Orange": "#e2701c", "Yellow": "#f0c22b",
    "Green": "#2f7d43", "Dark green": "#1f4432", "Blue": "#2566b8", "Dark blue": "#1b2c55",
}  # fmt: skip
_FABRIC = {
    "White": "#efece4", "Beige": "#cdbb9c", "Grey": "#8d8f90", "Anthracite": "#35383b",
    "Red": "#a92b2b", "Rose": "#d79a9a", "Rust": "#b4592f", "Mustard": "#cf9f35",
    "Sage": "#8d9f7f", "Dark green": "#2c5242", "Blue": "#3b6a97", "Brown leather": "#6a4029",
}  # fmt: skip
_WOOD = {
    "White": "#eeebe4", "Birch": "#dcc39a", "Oak": "#c29a63", "Teak": "#a06a38",
    "Cherry": "#8a4526", "Walnut": "#5e3e28", "Wenge": "#36261d", "Black": "#1d1c1b",
    "Steel": "#a9adb0", "Red": "#a8312a", "Green": "#47694f", "Blue": "#3d6285",
}  # fmt: skip
_OF = {"wood": _WOOD, "legs": _WOOD, "fabric": _FABRIC, "seat": _FABRIC, "back": _FABRIC, "arms": _FABRIC}
_GREYS = 0.1  # fraction of the square's width
_VIVID = 0.85  # saturation of the hues
_HEX = re.compile("#[0-9a-f]{6}")


def paints_of(part_name: str) -> dict[str, str]:
    """Return twelve paints that suit a part, such as #c3202a, by name."""
    return _OF.get(part_name, _CAR)


def rgb(paint: str) -> Rgb:
    """Return the colour of a paint, sRGB 0..1; black if it is none.

    >>> rgb("#ff0000")
    (1.0, 0.0, 0.0)
    """
    red, green, blue = bytes.fromhex(paint[1:] if _HEX.fullmatch(paint) else "000000")
    return red / 255, green / 255, blue / 255


def as_paint(colour: Rgb) -> str:
    """Return a colour, sRGB 0..1, as a paint.

    >>> as_paint((1.0, 0.0, 0.0))
    '#ff0000'
    """
    return "#" + bytes(round(255 * channel) for channel in colour).hex()


def square_colour(across: float, down: float) -> Rgb:
    """Return a colour of the square: greys at the left, hues to the right; white at the top, black at the bottom."""
    hue = max(0.0, (across - _GREYS) / (1 - _GREYS))
    return colorsys.hls_to_rgb(hue, 1 - down, _VIVID if across >= _GREYS else 0.0)
