"""The mirror image of an object on a glossy floor."""

import math

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from core.photos.candidates import in_pixels, network_candidate
from core.photos.detector import Box

_SIDE = 64  # px: longer side of the box at which the halves are compared
_SLOPES = np.linspace(-0.45, 0.45, 7)  # of the line between object and mirror image
_HEIGHTS = 0.4, 0.95  # of the line at the middle of the box, from its top; a lower one leaves little to remove
_LEAST = 0.2  # height of the compared halves relative to the box, at least
_ALIKE = 0.65  # correlation of gradients; 26 photographs have at most 0.62, most of them 0.3
_CLEARLY_ALIKE = 0.85  # likewise, without looking at saliency
_FAINT = 0.85  # contrast of a mirror image relative to the object's, at most: cars from above are symmetric, too
_SALIENT = 0.1  # fraction of the salient object below the line, at most: pedestals resemble their seats


def above_reflection(image: Image.Image, box: Box) -> Bool[np.ndarray, "height width"] | None:
    """Return the pixels above the line at which an RGB image is mirrored; None without mirror image in the box."""
    import cv2  # imports in 0.2 s, and many images do not need it

    left, top, right, bottom = in_pixels(box, image)
    window = left, top, right, min(image.height, bottom + (bottom - top) // 2)
    scale = _SIDE / max(right - left, bottom - top)
    width, height = (max(8, round(scale * size)) for size in (right - left, window[3] - top))
    small = image.crop(window).resize((width, height), Image.Resampling.BOX)
    colours = cv2.GaussianBlur(np.asarray(small, np.float32), (0, 0), 1.0)
    tall = scale * (bottom - top)
    best = (_ALIKE, 0, 0.0)
    for slope in _SLOPES.tolist():
        level = np.array([[1, 0, 0], [-slope, 1, slope * width / 2]], np.float32)
        sheared = cv2.warpAffine(colours, level, (width, height), borderMode=cv2.BORDER_REPLICATE)
        gradients = np.stack(np.gradient(sheared, axis=(0, 1)), -1).reshape(height, -1, 2)
        for line in range(math.ceil(_HEIGHTS[0] * tall), int(_HEIGHTS[1] * tall)):
            if min(line, height - line) >= _LEAST * tall:
                best = max(best, (_correlation(gradients, line), line, slope))
    alike, line, slope = best
    if not line:
        return None
    rows, columns = np.mgrid[: image.height, : image.width] + 0.5
    above = rows - top < line / scale + slope * (columns - (left + right) / 2)
    if alike > _CLEARLY_ALIKE:
        return above
    salient = network_candidate(image, box).opacity > 0.5
    return above if (salient & ~above).sum() < _SALIENT * salient.sum() else None


def _correlation(gradients: Float[np.ndarray, "height values 2"], line: int) -> float:
    """Return the correlation of the gradients above a row with fainter ones below it, upside down; else 0."""
    half = min(line, len(gradients) - line)
    upper = gradients[line - half : line][::-1] * np.array([-1, 1], np.float32)
    lower = gradients[line : line + half]
    contrasts = float(np.linalg.norm(upper)), float(np.linalg.norm(lower))
    if contrasts[1] > _FAINT * contrasts[0]:
        return 0.0
    return float((upper * lower).sum()) / max(contrasts[0] * contrasts[1], 1e-6)
