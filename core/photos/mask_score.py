"""How likely a mask is to be one whole object, from what can be seen of it."""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image
from scipy.ndimage import binary_erosion, gaussian_gradient_magnitude, label
from skimage.color import rgb2lab

from core.classifiers.category import predict_category
from core.models.library import category_classifier
from core.photos.candidates import Candidate, Seen, find_candidates

_SIDE = 320
"""px: the longer side at which masks are judged, that of the saliency network"""
_EDGE = 10.0
"""CIE76 per px: a slope that is an edge for certain"""
_AGREED = 0.85
"""overlap from which a mask and the saliency network are of one opinion: its edges are not that fine"""
_EVEN, _SLOPE = 0.86, 0.13
"""score of a mask that is as likely right as wrong; by how much more the odds are 2.7 times as high: of composites"""


class Evidence(NamedTuple):
    """What speaks for a mask, each 0..1."""

    edges: float
    """how much of its contour lies on edges of the image"""
    salient: float
    """overlap with what the saliency network sees in all its looks"""
    known: float
    """the probability that it shows a category that has a model"""
    whole: float
    """the share that is one piece"""


WEIGHTS = Evidence(0.05, 0.43, 0.42, 0.1)
"""sum 1; chosen on 60 composites of validation meshes"""


def score(evidence: Evidence) -> float:
    """0..1, how good a mask is."""
    return sum(weight * value for weight, value in zip(WEIGHTS, evidence, strict=True))


def rank_candidates(seen: Seen) -> list[tuple[Candidate, float]]:
    """The masks of an image, the likeliest first, each with the probability that it is the object."""
    found = find_candidates(seen)
    if len(found) == 1 and found[0].certain:
        return [(found[0], 1.0)]
    judge = Judge(seen)
    scores = [score(judge.look(candidate)) for candidate in found]
    ranked = sorted(zip(scores, found, strict=True), key=lambda one: -one[0])
    return [(candidate, _confidence(value)) for value, candidate in ranked]


def _confidence(value: float) -> float:
    return 1 / (1 + math.exp(-(value - _EVEN) / _SLOPE))


class Judge:
    """What is the same for all masks of an image."""

    def __init__(self, seen: Seen) -> None:
        self._size = _small(seen.image.size)
        colours = Image.fromarray((seen.colours * 255 + 0.5).astype(np.uint8)).resize(self._size, Image.Resampling.BOX)
        self._colours = np.asarray(colours, np.float32) / 255
        lab = rgb2lab(self._colours)
        self._slope = np.linalg.norm([gaussian_gradient_magnitude(lab[..., axis], 1.0) for axis in range(3)], axis=0)
        self._salient = None if seen.agreed is None else self._reduced(seen.agreed)

    def look(self, candidate: Candidate) -> Evidence:
        """What speaks for a mask."""
        mask = self._reduced(candidate.opacity) > 0.5
        if not mask.any():
            return Evidence(0, 0, 0, 0)
        contour = mask & ~binary_erosion(mask, border_value=1)
        areas = np.bincount(label(mask, np.ones((3, 3)))[0].ravel())[1:]
        return Evidence(
            float(np.minimum(1, self._slope[contour] / _EDGE).mean()) if contour.any() else 0.0,
            0.5 if self._salient is None else min(1.0, _soft_overlap(mask, self._salient) / _AGREED),
            self._known(mask),
            float(areas.max() / areas.sum()),
        )

    def _reduced(self, values: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "h w"]:
        return np.asarray(Image.fromarray(values.astype(np.float32)).resize(self._size, Image.Resampling.BOX))

    def _known(self, mask: Bool[np.ndarray, "h w"]) -> float:
        classifier = category_classifier()
        if classifier is None:
            return 0.5
        guess = predict_category(classifier, torch.from_numpy(self._colours), torch.from_numpy(mask))
        return max(guess.values())


def _small(size: tuple[int, int]) -> tuple[int, int]:
    scale = min(1.0, _SIDE / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _soft_overlap(mask: Bool[np.ndarray, "h w"], salient: Float[np.ndarray, "h w"]) -> float:
    return float(np.minimum(mask, salient).sum() / np.maximum(mask, salient).sum())
