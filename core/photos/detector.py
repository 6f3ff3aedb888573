"""Detection of chairs and cars by SSD-MobileNetV2 (Sandler et al. 2018), trained on Open Images V4 by MediaPipe."""

import logging
import math
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from core.geometry.pixels import bounding_box
from core.runtime.networks import NETWORKS, run_network

Box = tuple[float, float, float, float]  # left, top, right, bottom as fractions of the image's width and height

_SIDE = 300  # px of the network's input
_CLASSES = {"chairs": (5,), "cars": (18, 23)}  # of Open Images: chair; vehicle and car
_MIN_SCORE = 0.16  # above it, 26 of 26 photographs have the right category
_MIN_OTHER_SCORE = 0.3  # the same for objects other than the most prominent one
_SAME = 0.5  # intersection over union from which two boxes count as one object
_CENTRE_SCALE, _SIZE_SCALE = 10.0, 5.0  # of the encoded boxes, from the network's training
UNDETECTED = dict.fromkeys(_CLASSES, 0.2)
"""Category probabilities of a photograph without detections: the detector misses some toys and drawings."""


class Detection(NamedTuple):
    """A detected object."""

    box: Box
    scores: dict[str, float]  # by category, 0..1

    @property
    def category(self) -> str:
        """Category with the higher score."""
        return max(self.scores, key=self.scores.__getitem__)

    @property
    def score(self) -> float:
        """The higher score, 0..1."""
        return max(self.scores.values())

    @property
    def prominence(self) -> float:
        """Score weighted by size and closeness to the image's centre."""
        left, top, right, bottom = self.box
        off_centre = math.hypot((left + right) / 2 - 0.5, (top + bottom) / 2 - 0.5)
        return self.score * ((right - left) * (bottom - top)) ** 0.25 * (1 - off_centre / 2)

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each category; the rest to 1 is neither."""
        total = sum(self.scores.values()) + _MIN_SCORE
        return {category: score / total for category, score in self.scores.items()}


def detect(image: Image.Image) -> tuple[Detection, ...] | None:
    """Find chairs and cars in an RGB image, the most prominent first.

    None, with a warning, if the network's files are missing or damaged.
    """
    try:
        return _detect(image.resize((_SIDE, _SIDE), Image.Resampling.BICUBIC).tobytes())
    except ValueError as error:
        logging.getLogger(__name__).warning("objects are found without the detector: %s", error)
        return None


def detection_of(mask: Bool[np.ndarray, "height width"], detections: Sequence[Detection]) -> Detection | None:
    """Return the detection whose box fits a mask best; None if none overlaps it by half."""
    box = mask_box(mask)
    best = max(detections, key=lambda detection: box_overlap(detection.box, box), default=None)
    return best if best and box_overlap(best.box, box) >= _SAME else None


def mask_box(mask: Bool[np.ndarray, "height width"]) -> Box:
    """Return the bounding box of a mask."""
    height, width = mask.shape
    left, top, right, bottom = bounding_box(mask)
    return left / width, top / height, right / width, bottom / height


def box_overlap(first: Box, second: Box) -> float:
    """Return the intersection over union of two boxes.

    Example:
        >>> box_overlap((0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.5, 1.0))
        0.5
    """
    across = max(0.0, min(first[2], second[2]) - max(first[0], second[0]))
    down = max(0.0, min(first[3], second[3]) - max(first[1], second[1]))
    areas = ((box[2] - box[0]) * (box[3] - box[1]) for box in (first, second))
    return across * down / max(sum(areas) - across * down, 1e-9)


@lru_cache(maxsize=8)
def _detect(pixels: bytes) -> tuple[Detection, ...]:
    """Run the network; cached, since a photo is cut out again after every stroke."""
    values = np.frombuffer(pixels, np.uint8).reshape(1, _SIDE, _SIDE, 3)
    outputs = run_network(NETWORKS / "ssd_oidv4.onnx", values.astype(np.float32) / 127.5 - 1)
    boxes = _decode(outputs["raw_outputs_box_encodings"][0])
    class_scores = 1 / (1 + np.exp(-outputs["raw_outputs_class_predictions"][0]))
    scores = np.stack([class_scores[:, classes].max(1) for classes in _CLASSES.values()], 1)
    selected: list[Detection] = []
    for index in np.argsort(-scores.max(1)):
        if scores[index].max() < _MIN_SCORE:
            break
        left, top, right, bottom = map(float, boxes[index])
        detection = Detection((left, top, right, bottom), dict(zip(_CLASSES, scores[index].tolist(), strict=True)))
        if all(box_overlap(detection.box, better.box) < _SAME for better in selected):  # non-maximum suppression
            selected.append(detection)
    selected.sort(key=lambda detection: -detection.prominence)
    return (*selected[:1], *(detection for detection in selected[1:] if detection.score >= _MIN_OTHER_SCORE))


def _decode(encoded: Float[np.ndarray, "anchors 4"]) -> Float[np.ndarray, "anchors 4"]:
    """Decode boxes (left, top, right, bottom) from offsets and sizes relative to the anchors."""
    low, high = np.split(_anchors(), 2, axis=1)
    centre = (low + high) / 2 + encoded[:, :2] / _CENTRE_SCALE * (high - low)
    half = np.exp(encoded[:, 2:] / _SIZE_SCALE) * (high - low) / 2
    return np.concatenate(((centre - half)[:, ::-1], (centre + half)[:, ::-1]), 1).clip(0, 1)


@cache
def _anchors() -> Float[np.ndarray, "anchors 4"]:
    """Load top, left, bottom and right as fractions of the image. Raises ``ValueError`` for an unreadable file."""
    try:
        return np.load(NETWORKS / "ssd_anchors.npy")
    except (OSError, ValueError, EOFError) as error:
        raise ValueError("ssd_anchors.npy is missing or damaged") from error
