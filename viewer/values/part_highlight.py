"""The glow over a part of the object in the view."""

import numpy as np
import torch
from jaxtyping import Bool, Float32, UInt8
from scipy import ndimage
from torch.nn import functional

_GLOW = np.array((84, 163, 224), np.float32)  # sRGB
_OUTER = np.array((10, 14, 20), np.float32)
_INNER = np.array((255, 255, 255), np.float32)
"""sRGB of the lines around a part and inside of it: on any object one of them contrasts"""
_OPACITY, _LINE_OPACITY = 0.34, 0.8  # of the glow, and of the lines at its edge
_SOFT = 0.8  # px over which edges are smoothed: first of the mask, then of the glow


def part_highlight(
    mask: Bool[np.ndarray, "rows columns"], opacity: Float32[np.ndarray, "height width"]
) -> UInt8[np.ndarray, "height width 4"]:
    """Return the RGBA pixels of a glow.

    Args:
        mask: the part's pixels, in an image of any size.
        opacity: that of the object, at the size of the glow.
    """
    soft = torch.from_numpy(ndimage.gaussian_filter(mask.astype(np.float32), _SOFT))
    wide = functional.interpolate(soft[None, None], opacity.shape, mode="bilinear", align_corners=False)[0, 0].numpy()
    cover = ndimage.gaussian_filter((2.5 * wide - 0.75).clip(0, 1) * opacity.clip(0, 1), _SOFT)
    line = 4 * cover * (1 - cover)
    inside = (3 * cover - 1).clip(0, 1)[..., None]
    colour = line[..., None] * (_OUTER + inside * (_INNER - _OUTER)) + (1 - line[..., None]) * _GLOW
    alpha = _OPACITY * cover * (1 - line) + _LINE_OPACITY * line
    return (np.dstack((colour, 255 * alpha)) + 0.5).astype(np.uint8)
