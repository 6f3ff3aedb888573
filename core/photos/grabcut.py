"""GrabCut (Rother et al. 2004, OpenCV's) at a small size for speed."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from core.photos.plain_background import NoBackgroundError

_SIDE = 320  # px: longer side for GrabCut, twice a model's image size
_ROUNDS = 4


def grabcut(
    image: Image.Image, labels: UInt8[np.ndarray, "height width"], window: tuple[int, int, int, int]
) -> Bool[np.ndarray, "height width"]:
    """Segment the object within a window (left, top, right, bottom in px); the rest of the image is background.

    Args:
        image: RGB.
        labels: OpenCV's: 0 and 1 are surely background and object, 2 and 3 probably.

    Raises ``ValueError`` for labels without object, :class:`NoBackgroundError` for labels without background.
    """
    import cv2  # imports in 0.2 s, and many images do not need it

    left, top, right, bottom = window
    crop = np.asarray(image.crop(window))
    scale = min(1.0, _SIDE / max(crop.shape[:2]))
    size = max(1, round(crop.shape[1] * scale)), max(1, round(crop.shape[0] * scale))
    small = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    cropped_labels = np.ascontiguousarray(labels[top:bottom, left:right])
    seeds = cv2.resize(cropped_labels, size, interpolation=cv2.INTER_NEAREST)
    if not np.isin(seeds, (cv2.GC_FGD, cv2.GC_PR_FGD)).any():
        raise ValueError("no object found: the strokes removed all of it")
    if not np.isin(seeds, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        raise NoBackgroundError("the strokes add the whole image to the object: leave some background")
    mixtures = np.zeros((1, 65)), np.zeros((1, 65))
    with ThreadPoolExecutor(1) as new_thread:  # has OpenCV's first random numbers; the caller's stay as they are
        job = new_thread.submit(
            lambda: cv2.grabCut(small, seeds, (0, 0, 1, 1), *mixtures, _ROUNDS, cv2.GC_INIT_WITH_MASK)
        )
    result, *_ = job.result()
    opacity = np.isin(result, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    mask = np.zeros(labels.shape, dtype=bool)
    mask[top:bottom, left:right] = cv2.resize(opacity, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    return mask
