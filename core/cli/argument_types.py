"""Parsers of option values. Each raises ``ArgumentTypeError`` with one line for wrong text."""

import argparse
import math
import re


def view_numbers(text: str) -> tuple[int, ...]:
    """Parse whole numbers separated by commas, ``V,V``."""
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"views are whole numbers V,V, not {text!r}") from None


def part(text: str) -> tuple[int, int]:
    """Parse part K of N, ``K/N``, with K from 1."""
    which, _, parts = text.partition("/")
    if not (which.isdecimal() and parts.isdecimal() and 1 <= int(which) <= int(parts)):
        raise argparse.ArgumentTypeError(f"a part is K/N, like 1/2, not {text!r}")
    return int(which), int(parts)


def image_size(text: str) -> tuple[int, int]:
    """Parse a width and height in px, ``WxH``, or one number for a square."""
    width, _, height = text.lower().partition("x")
    sides = width, height or width
    if not all(side.isdecimal() and int(side) for side in sides):
        raise argparse.ArgumentTypeError(f"a size is PX or WxH, like 512 or 854x480, not {text!r}")
    return int(sides[0]), int(sides[1])


def box(text: str) -> tuple[float, ...]:
    """Parse left, top, right and bottom, ``X0,Y0,X1,Y1``."""
    try:
        left, top, right, bottom = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a box is four numbers X0,Y0,X1,Y1, not {text!r}") from None
    return left, top, right, bottom


def point(text: str) -> tuple[float, float]:
    """Parse two numbers ``X,Y``."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a point is two numbers X,Y, not {text!r}") from None
    return x, y


def edits(text: str) -> tuple[tuple[str, float], ...]:
    """Parse names of directions and amounts in standard deviations, ``NAME=X,NAME=X``."""
    found = []
    for word in text.split(","):
        name, _, amount = word.partition("=")
        try:
            value = float(amount)
        except ValueError:
            value = math.nan
        if not (name.strip() and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"edits are NAME=X, like taller=1.5,darker=-1, not {text!r}")
        found.append((name.strip(), value))
    return tuple(found)


def paints(text: str) -> tuple[tuple[str, tuple[float, float, float]], ...]:
    """Parse parts and sRGB colours, ``#rrggbb`` or ``PART=#rrggbb,PART=#rrggbb``.

    Channels are returned as 0..1, and a missing part as "".
    """
    found = []
    for word in text.split(","):
        part, _, colour = word.rpartition("=")
        match = re.fullmatch("#?([0-9a-fA-F]{2})([0-9a-fA-F]{2})([0-9a-fA-F]{2})", colour.strip())
        if not match:
            raise argparse.ArgumentTypeError(f"a paint is #rrggbb or PART=#rrggbb, not {text!r}")
        red, green, blue = (int(channel, 16) / 255 for channel in match.groups())
        found.append((part.strip(), (red, green, blue)))
    return tuple(found)


def degrees(text: str) -> float:
    """Parse a finite angle in degrees; return radians."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"an angle is a number of degrees, not {text!r}")
    return math.radians(value)


def count(text: str) -> int:
    """Parse a whole number of at least 1."""
    if not text.strip().isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)
