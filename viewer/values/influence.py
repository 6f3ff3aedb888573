"""What a slider changes: where in the picture, and whether it moves the silhouette. Pure."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from core.rendering.progressive import Frame
from viewer.values.view_modes import heat

_SEEN = 4 / 255
"""of a colour: what an eye may notice"""
_THERE = 0.5
"""opacity from which a pixel counts as the object's"""


@dataclass(frozen=True, eq=False)
class Influence:
    """The difference between two pictures from the same camera."""

    picture: UInt8[np.ndarray, "height width 3"]
    """dark where nothing changes, the brighter the more"""
    changed: float
    """share of the object's pixels whose colour changes, 0..1"""
    leak: float
    """the largest change of any pixel's opacity, 0..1: how far the silhouette moves"""

    @classmethod
    def between(cls, low: Frame, high: Frame) -> "Influence":
        """Of a slider at two of its values."""
        moved = np.abs(low.image.astype(float) - high.image).max(-1) / 255
        there = np.maximum(low.opacity, high.opacity) > _THERE
        changed = float((moved > _SEEN)[there].mean()) if there.any() else 0.0
        leak = float(np.abs(low.opacity - high.opacity).max())
        return cls(heat(moved / max(moved.max(), _SEEN)), changed, leak)
