"""The influence of a slider: the pixels that it changes."""

import numpy as np
from jaxtyping import UInt8

from core.detail.progressive import Frame
from viewer.values.view_modes import colour_map

_VISIBLE = 4 / 255  # least visible difference of colours, 0..1; smaller ones are not amplified
_OVER = 0.8  # opacity of the overlay at large changes


def influence(low: Frame, high: Frame) -> UInt8[np.ndarray, "height width 4"]:
    """Return an RGBA overlay of two renders' differences: transparent for none, bright for large ones."""
    change = np.abs(low.image.astype(float) - high.image).max(-1) / 255
    relative = change / max(change.max(), _VISIBLE)
    opacity = (255 * _OVER * np.minimum(1.0, 3 * relative)).astype(np.uint8)
    return np.dstack((colour_map(relative), opacity))
