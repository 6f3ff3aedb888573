"""Checked numbers of files and settings. Imports nothing large, as every command's parser needs it."""

from typing import Any

_LARGEST = 1e300  # limit of a number, as JSON integers have none
_LONGEST = 40  # characters of a value in an error


def number(value: Any, name: str = "a number") -> float:
    """Return a finite number as a float. Raises ``ValueError`` for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _LARGEST:
        raise ValueError(f"{name} must be a finite number, got {abbreviated(value)}")
    return float(value)


def whole(value: Any, name: str = "a number") -> int:
    """Return a whole number, such as 128 or 128.0, as an integer. Raises ``ValueError`` for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1:
        raise ValueError(f"{name} must be a whole number, got {abbreviated(value)}")
    return int(value)


def abbreviated(value: Any) -> str:
    """Return a value for an error, cut off if it is long."""
    text = repr(value)
    return text if len(text) < _LONGEST else f"{text[: _LONGEST - 4]}..."
