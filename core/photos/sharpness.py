"""How sharp an image is: its blur, and how soft the edge of a mask is beyond that."""

import math

import numpy as np
from jaxtyping import Float
from scipy.ndimage import binary_erosion, gaussian_filter
from torch import Tensor

_BLUR_AGAIN = 2.0  # px, by which an image is blurred once more: the sharper it was, the more that flattens its edges
_SHARP = 1.0  # px: an edge between two pixels, and of renders that are anti-aliased, seems to be blurred by less
_STEEPEST = 0.03  # of an image's gradients: those of its edges
_MAX_BLUR = 6.0  # px: more is a shade, not an edge
_SOFT = 0.1  # Opacities from this to 1 less this are on an edge.
_RAMP = 2.56  # standard deviations of a blur across which it makes an edge pass through those


def measure_blur(pixels: Float[Tensor, "height width 3"]) -> float:
    """The standard deviation, in px, of the blur of an image's edges; 0 where they are sharp.

    By blurring it again (Zhuo and Sim 2011): that divides the gradient of an edge of blur s by sqrt(1 + (2 / s)^2).
    """
    grey = pixels.mean(-1).cpu().numpy()
    steep = _gradient(grey)
    edges = steep >= max(np.quantile(steep, 1 - _STEEPEST), 1e-3)
    if not edges.any():
        return 0.0
    ratio = float(np.median(steep[edges] / _gradient(gaussian_filter(grey, _BLUR_AGAIN))[edges].clip(1e-6)))
    seeming = _BLUR_AGAIN / math.sqrt(max(ratio**2 - 1, (_BLUR_AGAIN / _MAX_BLUR) ** 2))
    return math.sqrt(max(0.0, seeming**2 - _SHARP**2))


def edge_softness(opacity: Float[Tensor, "height width"], blur: float) -> float:
    """By how many px a mask's edge is softer than pixels and the blur of its image make it: how far it may be off."""
    values = opacity.cpu().numpy()
    mask = values > 0.5
    length = int((mask & ~binary_erosion(mask)).sum())
    soft = int(((values > _SOFT) & (values < 1 - _SOFT)).sum())
    ramp = soft / max(1, length) / _RAMP
    return math.sqrt(max(0.0, ramp**2 - blur**2 - (1 / _RAMP) ** 2))


def _gradient(grey: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    return np.hypot(*np.gradient(grey))
