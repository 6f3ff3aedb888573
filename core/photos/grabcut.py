"""GrabCut (Rother et al. 2004, OpenCV's) at a small size for speed."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float, UInt8

from core.photos.plain_background import NoBackgroundError

_SIDE = 320  # px: longer side for GrabCut, twice a model's image size
_ROUNDS = 4


def grabcut(
    colours: Float[np.ndarray, "height width 3"],
    labels: UInt8[np.ndarray, "height width"],
    window: tuple[int, int, int, int],
) -> Bool[np.ndarray, "height width"]:
    """Segment the object within a window (left, top, right, bottom in px); the rest of the image is background.

    Args:
        colours: 0..1.
        labels: OpenCV's: 0 and 1 are surely background and object, 2 and 3 probably.

    Raises ``ValueError`` for labels without object, :class:`NoBackgroundError` for labels without background.
    """
    import cv2  # imports in 0.2 s, and many images do not need it

    left, top, right, bottom = window
    crop = np.ascontiguousarray((colours[top:bottom, left:right] * 255 + 0.5).astype(np.uint8))
    scale = min(1.0, _SIDE / max(crop.shape[:2]))
    size = max(1, round(crop.shape[1] * scale)), max(1, round(crop.shape[0] * scale))
    image = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    cropped_labels = np.ascontiguousarray(labels[top:bottom, left:right])
    seeds = cv2.resize(cropped_labels, size, interpolation=cv2.INTER_NEAREST)
    if not np.isin(seeds, (cv2.GC_FGD, cv2.GC_PR_FGD)).any():
        raise ValueError("no object found: the strokes removed all of it")
    if not np.isin(seeds, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        raise NoBackgroundError("the strokes add the whole image to the object: leave some background")
    mixtures = np.zeros((1, 65)), np.zeros((1, 65))
    with ThreadPoolExecutor(1) as new_thread:  # has OpenCV's first random numbers; the caller's stay as they are
        job = new_thread.submit(
            lambda: cv2.grabCut(image, seeds, (0, 0, 1, 1), *mixtures, _ROUNDS, cv2.GC_INIT_WITH_MASK)
        )
    result, *_ = job.result()
    opacity = np.isin(result, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    mask = np.zeros(colours.shape[:2], dtype=bool)
    mask[top:bottom, left:right] = cv2.resize(opacity, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    return mask
