"""The glow over a part of the object in the view."""

import numpy as np
import torch
from jaxtyping import Bool, Float32, UInt8
from scipy import ndimage
from torch.nn import functional

_GLOW = (84, 163, 224)  # sRGB of the glow
_LINES = np.array([[10, 14, 20], [255, 255, 255]], np.float32)  # around a part and inside of it: one of them contrasts
_OPACITY, _LINE_OPACITY = 0.34, 0.8  # of the glow, and of the lines at its edge
_SOFT = 0.8  # px of the mask over which its edge is smoothed


def part_highlight(
    mask: Bool[np.ndarray, "rows columns"], opacity: Float32[np.ndarray, "height width"]
) -> UInt8[np.ndarray, "height width 4"]:
    """Return the RGBA pixels of a glow.

    Args:
        mask: the part's pixels, in an image of any size.
        opacity: that of the object, at the size of the glow.
    """
    soft = torch.from_numpy(ndimage.gaussian_filter(mask.astype(np.float32), _SOFT))
    cover = functional.interpolate(soft[None, None], opacity.shape, mode="bilinear", align_corners=False)[0, 0].numpy()
    cover = (2.5 * cover - 0.75).clip(0, 1) * opacity.clip(0, 1)
    line = 4 * cover * (1 - cover)
    alpha = _OPACITY * cover * (1 - line) + _LINE_OPACITY * line
    colour = np.where(line[..., None] > 0.3, _LINES[(cover > 0.5).astype(int)], np.array(_GLOW, np.float32))
    return np.dstack((colour, 255 * alpha + 0.5)).astype(np.uint8)
