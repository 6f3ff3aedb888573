"""Candidate masks of the object in a box: the saliency network's, and one by colours."""

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image
from scipy.ndimage import binary_erosion, label

from core.photos.detector import Box, box_overlap, share_box
from core.photos.grabcut import grabcut
from core.photos.saliency import predict_saliency

_ROOM = 1.3  # network's crop over the box, per side; 1.05 and 1.15 lose thin parts of 60 composites
_LEARNT = 1.5  # side of the window around the box whose colours are the background's
_HINT = 0.25  # saliency from which a thin part, such as a leg, may be present: the network sees it as edge only
_NETWORK_ERROR = 0.006  # edge uncertainty of a saliency mask, relative to the crop: two pixels at the network's input
_PREFERRED = 0.1  # box overlap by which GrabCut's mask must exceed the network's
_CONSTANT, _AGREEMENT = -1.8, 4.2  # of the log-odds that a mask overlaps the true one by 0.75, fitted on composites
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
    white: bool = False  # white background, as in training images
    certain: bool = False  # from alpha, a plain background or a person
    confidence: float = 1.0  # probability that it is the object


def rank_candidates(image: Image.Image, box: Box) -> list[Candidate]:
    """Find the masks of an object in an image, the likeliest first.

    Args:
        image: RGB.
        box: around the object.
    """
    found = [one for one in (by_network(image, box), by_colours(image, box)) if one and (one.opacity > 0.5).any()]
    found.sort(key=lambda one: -_fit(one, box))
    if len(found) < 2:
        return [replace(one, confidence=_ALONE) for one in found]
    best, *others = found
    agreed = mask_overlap(best.opacity > 0.5, others[0].opacity > 0.5)
    sure = 1 / (1 + math.exp(-(_CONSTANT + _AGREEMENT * agreed)))
    return [replace(best, confidence=sure), *(replace(one, confidence=min(sure, 1 - sure)) for one in others)]


def _fit(candidate: Candidate, box: Box) -> float:
    """Score how well a mask fills its box, 0..1, plus a preference for the network."""
    return box_overlap(share_box(candidate.opacity > 0.5), box) + _PREFERRED * (candidate.found_by == "network")


def by_network(image: Image.Image, box: Box) -> Candidate:
    """Return the saliency network's mask in a box, including faint parts."""
    window = _in_pixels(_scaled(box, _ROOM), image)
    salient = (_salient(image, window) * (0.5 / _HINT)).clip(0, 1)
    side = max(window[2] - window[0], window[3] - window[1])
    # Inside an object the network may be unsure of its kind, but not of its presence.
    inside = binary_erosion(salient > 0.5, iterations=max(1, round(_NETWORK_ERROR * side)))
    return Candidate("network", np.where(inside, np.float32(1), salient), _NETWORK_ERROR * side)


def by_colours(image: Image.Image, box: Box) -> Candidate | None:
    """Return GrabCut's mask of pixels whose colours differ from the surroundings of a box."""
    colours = np.asarray(image, np.float32) / 255
    left, top, right, bottom = _in_pixels(box, image)
    labels = np.zeros(colours.shape[:2], np.uint8)
    labels[top:bottom, left:right] = 3
    with suppress(ValueError):
        mask = grabcut(colours, labels, _in_pixels(_scaled(box, _LEARNT), image))
        return Candidate("colours", mask.astype(np.float32))
    return None


def by_place(image: Image.Image, boxes: list[Box]) -> Candidate:
    """Return a mask that fills the boxes, for boxes without a detected object."""
    opacity = np.zeros((image.height, image.width), np.float32)
    for left, top, right, bottom in (_in_pixels(box, image) for box in boxes):
        opacity[top:bottom, left:right] = 1
    return Candidate("nothing but its place", opacity, confidence=0.0)


def salient_box(image: Image.Image) -> Box:
    """Return the box of the salient object of an image; the middle for a speck or nothing."""
    salient = _salient(image, (0, 0, *image.size)) > 0.5
    if not salient.any():
        return _MIDDLE
    left, top, right, bottom = box = share_box(salient)
    return box if min(right - left, bottom - top) > _MIN_BOX else _MIDDLE


def box_at(image: Image.Image, point: tuple[float, float]) -> Box:
    """Return the box of the salient object at a point (fractions of width and height)."""
    for share in _WINDOWS:
        pieces, _ = label(_salient(image, _in_pixels(_around(point, share, image), image)) > 0.5, np.ones((3, 3)))
        height, width = pieces.shape
        if piece := pieces[min(height - 1, int(point[1] * height)), min(width - 1, int(point[0] * width))]:
            return share_box(pieces == piece)
    return _around(point, _POINTED, image)


def _salient(image: Image.Image, window: tuple[int, int, int, int]) -> Float[np.ndarray, "height width"]:
    """Return the saliency map of a window (px) of an image, 0..1; zero without the network."""
    left, top, right, bottom = window
    whole, found = np.zeros((image.height, image.width), np.float32), predict_saliency(image.crop(window))
    if found is not None:
        whole[top:bottom, left:right] = found
    return whole


def mask_overlap(one: Bool[np.ndarray, "height width"], other: Bool[np.ndarray, "height width"]) -> float:
    """Return the intersection over union of two masks."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def _scaled(box: Box, factor: float) -> Box:
    """Scale a box about its middle, clipped to the image."""
    left, top, right, bottom = box
    across, down = (factor - 1) * (right - left) / 2, (factor - 1) * (bottom - top) / 2
    return max(0.0, left - across), max(0.0, top - down), min(1.0, right + across), min(1.0, bottom + down)


def _around(point: tuple[float, float], share: float, image: Image.Image) -> Box:
    """Return a square around a point, clipped to the image; its side is a fraction of the image's longer side."""
    across, down = (share * max(image.size) / size / 2 for size in image.size)
    x, y = point
    return max(0.0, x - across), max(0.0, y - down), min(1.0, x + across), min(1.0, y + down)


def _in_pixels(box: Box, image: Image.Image) -> tuple[int, int, int, int]:
    left, top, right, bottom = box
    across, down = min(image.width - 1, int(left * image.width)), min(image.height - 1, int(top * image.height))
    right, bottom = math.ceil(right * image.width), math.ceil(bottom * image.height)
    return across, down, max(across + 1, right), max(down + 1, bottom)
