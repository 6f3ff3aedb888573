"""Types of option values. Each raises ``ArgumentTypeError`` with one line where they are wrong."""

import argparse
import math


def view_numbers(text: str) -> tuple[int, ...]:
    """Whole numbers, as ``V,V``."""
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"views are whole numbers V,V, not {text!r}") from None


def part(text: str) -> tuple[int, int]:
    """One of several parts, as ``K/N``."""
    which, _, parts = text.partition("/")
    if not (which.isdecimal() and parts.isdecimal() and 1 <= int(which) <= int(parts)):
        raise argparse.ArgumentTypeError(f"a part is K/N, like 1/2, not {text!r}")
    return int(which), int(parts)


def box(text: str) -> tuple[float, ...]:
    """Four numbers, as ``X0,Y0,X1,Y1``."""
    try:
        left, top, right, bottom = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a box is four numbers X0,Y0,X1,Y1, not {text!r}") from None
    return left, top, right, bottom


def point(text: str) -> tuple[float, float]:
    """Two numbers, as ``X,Y``."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"a point is two numbers X,Y, not {text!r}") from None
    return x, y


def degrees(text: str) -> float:
    """An angle of finite degrees; in radians."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"an angle is a number of degrees, not {text!r}")
    return math.radians(value)


def count(text: str) -> int:
    """A whole number of at least 1."""
    if not text.strip().isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)
