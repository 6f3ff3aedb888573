"""The two codes of an object."""

from typing import Literal

Part = Literal["shape", "texture"]
PARTS: tuple[Part, Part] = ("shape", "texture")
