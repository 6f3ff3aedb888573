"""Parsers of option values. Each raises ``ArgumentTypeError`` with one line for wrong text."""

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path

from core.runtime.pipes import as_file

_FARTHEST_EDIT = 10.0  # standard deviations; beyond, nothing is left of an object
_ENDLESS = 10**9  # limit of counts that nothing else limits


def input_file(text: str) -> Path:
    """Parse the path of a file to read; the content of a pipe, such as /dev/stdin, is copied into a file."""
    try:
        return as_file(Path(text))
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def object_or_scene(text: str) -> int | Path:
    """Parse the number of a training object, or the path of a scene."""
    return int(text) if text.isdecimal() else input_file(text)


def model_name(text: str) -> str:
    """Parse the name or the path of a model."""
    return str(input_file(text))


def number_from(low: float, high: float, unit: str = "") -> Callable[[str], float]:
    """Return a parser of numbers in a range, with its unit for messages."""

    def parse(text: str) -> float:
        value = _as_number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be a number from {low:g} to {high:g}{unit}, not {text!r}")
        return value

    return parse


def whole_from(first: int, last: int) -> Callable[[str], int]:
    """Return a parser of whole numbers in a range."""

    def parse(text: str) -> int:
        value = _as_number(text)
        if not (first <= value <= last and value.is_integer()):
            raise argparse.ArgumentTypeError(f"must be a whole number from {first} to {last}, not {text!r}")
        return int(value)

    return parse


count = whole_from(1, _ENDLESS)


def degrees_up_to(limit: float) -> Callable[[str], float]:
    """Return a parser of angles from ``-limit`` to ``limit`` degrees, in radians."""
    parse = number_from(-limit, limit, " degrees")
    return lambda text: math.radians(parse(text))


def _as_number(text: str) -> float:
    """Return a number; NaN, which is in no range, for other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def view_numbers(text: str) -> tuple[int, ...]:
    """Parse whole numbers separated by commas, ``V,V``."""
    try:
        return tuple(map(whole_from(0, _ENDLESS), text.split(",")))
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"views are whole numbers V,V from 0, not {text!r}") from None


def image_size(text: str) -> tuple[int, int]:
    """Parse a width and height in px, ``WxH``, or one number for a square."""
    width, _, height = text.lower().partition("x")
    sides = width, height or width
    if not all(side.isdecimal() and int(side) for side in sides):
        raise argparse.ArgumentTypeError(f"a size is PX or WxH, like 512 or 854x480, not {text!r}")
    return int(sides[0]), int(sides[1])


def numbers(count: int, separator: str, above: float, form: str) -> Callable[[str], tuple[float, ...]]:
    """Return a parser of ``count`` finite numbers above a limit; ``form`` tells of them in messages."""

    def parse(text: str) -> tuple[float, ...]:
        values = tuple(map(_as_number, text.lower().split(separator)))
        if len(values) != count or not all(above < value < math.inf for value in values):
            raise argparse.ArgumentTypeError(f"{form}, not {text!r}")
        return values

    return parse


size_cm = numbers(3, "x", 0.0, "a size is WxDxH in centimetres, like 60x58x92")  # width, depth and height
box = numbers(4, ",", -math.inf, "a box is four numbers X0,Y0,X1,Y1")  # left, top, right and bottom
point = numbers(2, ",", -math.inf, "a point is two numbers X,Y")


def portion_cm(name: str) -> Callable[[str], tuple[str, float]]:
    """Return a parser of the length in centimetres of a portion of the object, which it names."""
    parse = numbers(1, ",", 0.0, f"the {name} have a length in centimetres, like 45")
    return lambda text: (name, parse(text)[0])


def edits(text: str) -> tuple[tuple[str, float], ...]:
    """Parse names of directions and amounts in standard deviations, ``NAME=X,NAME=X``."""
    changes = []
    for word in text.split(","):
        name, _, amount = word.partition("=")
        value = _as_number(amount)
        if not name.strip() or math.isnan(value):
            raise argparse.ArgumentTypeError(f"edits are NAME=X, like rounder=1.5,darker=-1, not {text!r}")
        if abs(value) > _FARTHEST_EDIT:
            limits = f"from -{_FARTHEST_EDIT:g} to {_FARTHEST_EDIT:g} standard deviations"
            raise argparse.ArgumentTypeError(f"an edit is {limits}, not {word!r}")
        changes.append((name.strip(), value))
    return tuple(changes)


def paints(text: str) -> tuple[tuple[str, tuple[float, float, float]], ...]:
    """Parse parts and sRGB colours, ``#rrggbb`` or ``PART=#rrggbb,PART=#rrggbb``.

    Channels are returned as 0..1, and a missing part as "".
    """
    colours = []
    for word in text.split(","):
        name, _, colour = word.rpartition("=")
        match = re.fullmatch("#?([0-9a-fA-F]{2})([0-9a-fA-F]{2})([0-9a-fA-F]{2})", colour.strip())
        if not match:
            raise argparse.ArgumentTypeError(f"a paint is #rrggbb or PART=#rrggbb, not {text!r}")
        red, green, blue = (int(channel, 16) / 255 for channel in match.groups())
        colours.append((name.strip(), (red, green, blue)))
    return tuple(colours)
