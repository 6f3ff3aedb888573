"""Candidate masks of the object in a box: the saliency network's, and one by colours."""

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image
from scipy.ndimage import binary_erosion, label

from core.photos.detector import Box, box_overlap, mask_box
from core.photos.grabcut import grabcut
from core.photos.saliency import predict_saliency

_MARGIN = 1.3  # network's crop over the box, per side; 1.05 and 1.15 lose thin parts of 60 composites
_SURROUNDINGS = 1.5  # side of the window around the box whose colours are the background's
_FAINT = 0.25  # saliency from which a thin part, such as a leg, may be present: the network sees it as edge only
_NETWORK_ERROR = 0.006  # edge uncertainty of a saliency mask, relative to the crop: two pixels at the network's input
_PREFERRED = 0.1  # box overlap by which GrabCut's mask must exceed the network's
_LOG_ODDS = (
    -1.8,
    4.2,
)  # that a mask overlaps the true one by 0.75: constant and factor of agreement, fitted on composites
_ALONE = 0.5  # confidence of a single mask
_WINDOWS = 0.4, 0.75  # crops around a point, relative to the image's longer side
_POINTED = 0.25  # likewise: the box around a point without salient object
_MIN_BOX = 0.05  # sides relative to the image: smaller salient objects are specks
_MIDDLE: Box = (0.1, 0.1, 0.9, 0.9)  # used if no object is found


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mask that may be the object's."""

    found_by: str  # method, for people
    opacity: Float[np.ndarray, "height width"]  # 0..1
    edge_error: float = 0.0  # px, uncertainty of the edges
    white: bool = False  # white or transparent background, as in training images
    certain: bool = False  # from alpha, a plain background or a person
    confidence: float = 1.0  # probability that it is the whole object and little else


def rank_candidates(image: Image.Image, box: Box) -> list[Candidate]:
    """Find the masks of an object in an image, the likeliest first.

    Args:
        image: RGB.
        box: around the object.
    """
    masks = (network_candidate(image, box), colour_candidate(image, box))
    candidates = [mask for mask in masks if mask and (mask.opacity > 0.5).any()]
    candidates.sort(key=lambda candidate: -_fit(candidate, box))
    if len(candidates) < 2:
        return [replace(candidate, confidence=_ALONE) for candidate in candidates]
    best, second = candidates
    confidence = _confidence(best.opacity > 0.5, second.opacity > 0.5)
    return [replace(best, confidence=confidence), replace(second, confidence=min(confidence, 1 - confidence))]


def network_agreement(image: Image.Image, mask: Bool[np.ndarray, "height width"]) -> float:
    """Return the confidence, 0..1, of a mask by its agreement with the saliency network."""
    return _confidence(mask, network_candidate(image, mask_box(mask)).opacity > 0.5)


def _confidence(first: Bool[np.ndarray, "height width"], second: Bool[np.ndarray, "height width"]) -> float:
    """Return the probability that one of two independent masks is right, by their overlap."""
    return 1 / (1 + math.exp(-(_LOG_ODDS[0] + _LOG_ODDS[1] * mask_overlap(first, second))))


def _fit(candidate: Candidate, box: Box) -> float:
    """Score how well a mask fills its box, 0..1, plus a preference for the network."""
    return box_overlap(mask_box(candidate.opacity > 0.5), box) + _PREFERRED * (candidate.found_by == "network")


def network_candidate(image: Image.Image, box: Box) -> Candidate:
    """Return the saliency network's mask in a box, including faint parts."""
    window = in_pixels(scaled(box, _MARGIN), image)
    salient = (_saliency_map(image, window) * (0.5 / _FAINT)).clip(0, 1)
    side = max(window[2] - window[0], window[3] - window[1])
    # Inside an object the network may be unsure of its kind, but not of its presence.
    inside = binary_erosion(salient > 0.5, iterations=max(1, round(_NETWORK_ERROR * side)))
    return Candidate("network", np.where(inside, np.float32(1), salient), _NETWORK_ERROR * side)


def colour_candidate(image: Image.Image, box: Box) -> Candidate | None:
    """Return GrabCut's mask of pixels whose colours differ from the surroundings of a box."""
    left, top, right, bottom = in_pixels(box, image)
    labels = np.zeros((image.height, image.width), np.uint8)
    labels[top:bottom, left:right] = 3
    with suppress(ValueError):
        mask = grabcut(image, labels, in_pixels(scaled(box, _SURROUNDINGS), image))
        return Candidate("colours", mask.astype(np.float32))
    return None


def box_candidate(image: Image.Image, boxes: list[Box]) -> Candidate:
    """Return a mask that fills the boxes, for boxes without a detected object."""
    opacity = np.any([filled(box, image) for box in boxes], axis=0).astype(np.float32)
    return Candidate("nothing but its place", opacity, confidence=0.0)


def salient_box(image: Image.Image) -> Box:
    """Return the box of the salient object of an image; the middle for a speck or nothing."""
    salient = _saliency_map(image, (0, 0, *image.size)) > 0.5
    if not salient.any():
        return _MIDDLE
    left, top, right, bottom = box = mask_box(salient)
    return box if min(right - left, bottom - top) > _MIN_BOX else _MIDDLE


def salient_box_at(image: Image.Image, point: tuple[float, float]) -> Box:
    """Return the box of the salient object at a point (fractions of width and height)."""
    for side in _WINDOWS:
        salient = _saliency_map(image, in_pixels(_around(point, side, image), image)) > 0.5
        pieces, _ = label(salient, np.ones((3, 3)))
        height, width = pieces.shape
        if piece := pieces[min(height - 1, int(point[1] * height)), min(width - 1, int(point[0] * width))]:
            return mask_box(pieces == piece)
    return _around(point, _POINTED, image)


def _saliency_map(image: Image.Image, window: tuple[int, int, int, int]) -> Float[np.ndarray, "height width"]:
    """Return the saliency map of a window (px) of an image, 0..1; zero without the network."""
    left, top, right, bottom = window
    saliency = np.zeros((image.height, image.width), np.float32)
    predicted = predict_saliency(image.crop(window))
    if predicted is not None:
        saliency[top:bottom, left:right] = predicted
    return saliency


def mask_overlap(first: Bool[np.ndarray, "height width"], second: Bool[np.ndarray, "height width"]) -> float:
    """Return the intersection over union of two masks."""
    return float((first & second).sum() / max(1, (first | second).sum()))


def scaled(box: Box, factor: float) -> Box:
    """Scale a box about its middle, clipped to the image."""
    left, top, right, bottom = box
    dx, dy = ((factor - 1) * size / 2 for size in (right - left, bottom - top))
    return max(0.0, left - dx), max(0.0, top - dy), min(1.0, right + dx), min(1.0, bottom + dy)


def _around(point: tuple[float, float], side: float, image: Image.Image) -> Box:
    """Return a square around a point, clipped to the image; its side is a fraction of the image's longer side."""
    dx, dy = (side * max(image.size) / size / 2 for size in image.size)
    x, y = point
    return max(0.0, x - dx), max(0.0, y - dy), min(1.0, x + dx), min(1.0, y + dy)


def filled(box: Box, image: Image.Image) -> Bool[np.ndarray, "height width"]:
    """Return the mask of a box in an image."""
    mask = np.zeros((image.height, image.width), bool)
    left, top, right, bottom = in_pixels(box, image)
    mask[top:bottom, left:right] = True
    return mask


def in_pixels(box: Box, image: Image.Image) -> tuple[int, int, int, int]:
    """Return a box in px of an image, at least one px wide and high."""
    left, top = (min(size - 1, int(start * size)) for start, size in zip(box[:2], image.size, strict=True))
    right, bottom = (math.ceil(end * size) for end, size in zip(box[2:], image.size, strict=True))
    return left, top, max(left + 1, right), max(top + 1, bottom)
