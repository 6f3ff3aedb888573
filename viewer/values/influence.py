"""The influence of a slider: the changed pixels and the movement of the silhouette."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from core.detail.progressive import Frame
from viewer.values.view_modes import colour_map

_VISIBLE = 4 / 255  # least visible difference of colours, 0..1; smaller ones are not amplified
_OVER = 0.8  # opacity of the overlay at large changes


@dataclass(frozen=True, eq=False)
class CodeInfluence:
    """The difference between two renders from the same camera."""

    image: UInt8[np.ndarray, "height width 4"]  # RGBA overlay: transparent for no change, bright for large changes
    leak: float  # largest change of a pixel's opacity, 0..1: movement of the silhouette

    @classmethod
    def between(cls, low: Frame, high: Frame) -> "CodeInfluence":
        """Compare renders at two values of a slider."""
        change = np.abs(low.image.astype(float) - high.image).max(-1) / 255
        leak = float(np.abs(low.opacity - high.opacity).max())
        relative = change / max(change.max(), _VISIBLE)
        opacity = (255 * _OVER * np.minimum(1.0, 3 * relative)).astype(np.uint8)
        return cls(np.dstack((colour_map(relative), opacity)), leak)
