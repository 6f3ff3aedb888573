"""The influence of a slider: where in the image, and whether it moves the silhouette. Pure."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from core.rendering.progressive import Frame
from viewer.values.view_modes import colour_map

_VISIBLE = 4 / 255
"""of a colour: what an eye may notice"""
_OPAQUE = 0.5
"""opacity from which a pixel counts as the object's"""


@dataclass(frozen=True, eq=False)
class CodeInfluence:
    """The difference between two renders from the same camera."""

    image: UInt8[np.ndarray, "height width 3"]
    """dark where nothing changes, the brighter the more"""
    changed: float
    """share of the object's pixels whose colour changes, 0..1"""
    leak: float
    """the largest change of any pixel's opacity, 0..1: how far the silhouette moves"""

    @classmethod
    def between(cls, low: Frame, high: Frame) -> "CodeInfluence":
        """Of a slider at two of its values."""
        moved = np.abs(low.image.astype(float) - high.image).max(-1) / 255
        there = np.maximum(low.opacity, high.opacity) > _OPAQUE
        changed = float((moved > _VISIBLE)[there].mean()) if there.any() else 0.0
        leak = float(np.abs(low.opacity - high.opacity).max())
        return cls(colour_map(moved / max(moved.max(), _VISIBLE)), changed, leak)
