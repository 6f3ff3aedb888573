"""Image sharpness: an image's blur, its sharpness among images of one scene, the softness of a mask's edge."""

import math

import numpy as np
from jaxtyping import Float
from scipy.ndimage import binary_erosion, gaussian_filter, laplace
from torch import Tensor

_BLUR_AGAIN = 2.0  # px of additional blur: the sharper the image, the more it flattens edges
_SHARP = 1.0  # px: apparent blur of an edge between two pixels, and of anti-aliased renders
_STEEPEST = 0.03  # fraction of an image's gradients that counts as edges
_MAX_BLUR = 6.0  # px: larger blur is shading, not an edge
_SOFT = 0.1  # opacities further than this from 0 and 1 are on an edge
_RAMP = 2.56  # width of such an edge after a blur, in its standard deviations


def measure_blur(pixels: Float[Tensor, "height width 3"]) -> float:
    """Measure the standard deviation, in px, of the blur of an image's edges; 0 if they are sharp.

    Blurs the image again (Zhuo and Sim 2011), which divides the gradient of an edge of blur s by sqrt(1 + (2 / s)^2).
    """
    grey = pixels.mean(-1).cpu().numpy()
    steep, flat = (np.hypot(*np.gradient(image)) for image in (grey, gaussian_filter(grey, _BLUR_AGAIN)))
    edges = steep >= max(np.quantile(steep, 1 - _STEEPEST), 1e-3)
    if not edges.any():
        return 0.0
    ratio = float(np.median(steep[edges] / flat[edges].clip(1e-6)))
    seeming = _BLUR_AGAIN / math.sqrt(max(ratio**2 - 1, (_BLUR_AGAIN / _MAX_BLUR) ** 2))
    return math.sqrt(max(0.0, seeming**2 - _SHARP**2))


def edge_softness(opacity: Float[Tensor, "height width"], blur: float) -> float:
    """Return the edge uncertainty of a mask in px: softness beyond pixels and the image's blur."""
    values = opacity.cpu().numpy()
    mask = values > 0.5
    length = int((mask & ~binary_erosion(mask)).sum())
    soft = int(((values > _SOFT) & (values < 1 - _SOFT)).sum())
    ramp = soft / max(1, length) / _RAMP
    return math.sqrt(max(0.0, ramp**2 - blur**2 - (1 / _RAMP) ** 2))


def measure_sharpness(grey: Float[np.ndarray, "height width"]) -> float:
    """Measure the variance of an image's Laplacian; it compares images of the same scene."""
    return float(laplace(grey).var())
