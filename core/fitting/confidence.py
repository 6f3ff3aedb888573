"""The confidence of a fitted camera: the probability that it is right, from results of the fit itself.

Most wrong cameras have a rival in another basin (above all the opposite view) that explains the photo about as well. So
a fit optimises rivals all around the object (:mod:`core.fitting.rivals`); the best is the runner-up. The relative
margin is the fraction of the runner-up's loss that the winner saves. Other wrong cameras lie in no basin, as the model
cannot explain the photo: their objective is flat, so its curvature gives a large uncertainty. :data:`CALIBRATION` is a
logistic regression on margin and uncertainty over fits of renders with known cameras. ``python -m core bench all``
calibrates its own fits anew and measures how well the confidence separates right from wrong.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

RIGHT_DEGREES = 10.0  # a camera rotated by less from the true one is in the right basin and counts as right
DOUBTFUL = 0.5  # cameras of less confidence are more often wrong than right
SURE = 0.9  # nearly all cameras of more confidence were right
_RIDGE = 0.1  # keeps weights finite if they separate all right fits from all wrong ones
_MIN_UNCERTAINTY = 0.01  # degrees
_MIN_MARGIN = -30.0  # keeps the relative margin finite if the winner's loss is far above the runner-up's
_EXPLAINED_PSNR, _EXPLAINED_WIDTH = 18.5, 1.0
"""PSNR (dB) at which a render half explains its photo, and the width of the transition.

Right fits of renders have at least 22 dB; of 17 right ones of photographs, two have 19.6 and 19.8, the others more,
but for a car of 1908 (18.7). A car that was squashed to a square has 17.4."""
_WRONG_MASK_FACTOR = 0.5
"""Factor on the confidence if the mask is certainly not the object; a guess, not calibrated. With it, no wrong camera
of 26 photographs has more than 0.79; without it, two had 0.87 and 0.97."""


class Calibration(NamedTuple):
    """Log-odds of a right camera: a constant, and weights of the relative margin and the log uncertainty."""

    constant: float
    margin: float
    uncertainty: float


CALIBRATION = Calibration(-0.89, 5.22, -1.90)
"""From 121 blind fits by ``normal`` of objects that no model was trained on: 103 chairs, 30 of them wrong, among them
stools that look alike from several sides, and 18 cars. In daylight or hard light, restarted if in doubt. 44 more fits
of cars, all right, agree with it."""


def confidence(margin: float, uncertainty: float, by: Calibration = CALIBRATION) -> float:
    """Return the probability that a fitted camera is right, 0..1.

    Args:
        margin: log ratio of the runner-up's loss to the winner's.
        uncertainty: degrees, of the winner within its basin.

    Example:
        >>> confidence(math.log(2), 1.0, Calibration(-2.0, 4.0, -1.0))
        0.5
    """
    odds = by.constant + by.margin * _relative_margin(margin) + by.uncertainty * _log_uncertainty(uncertainty)
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, odds))))


def in_words(confidence: float) -> Literal["doubtful", "likely", "sure"]:
    """Return the word for a confidence of 0..1."""
    if confidence < DOUBTFUL:
        return "doubtful"
    return "sure" if confidence > SURE else "likely"


def explained(psnr: float) -> float:
    """Return how well a render explains its photo, 0..1, from its PSNR (dB): 0.5 at 18.5 dB.

    Example:
        >>> round(explained(30.0), 3), round(explained(18.5), 3), round(explained(15.0), 3)
        (1.0, 0.5, 0.029)
    """
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, (psnr - _EXPLAINED_PSNR) / _EXPLAINED_WIDTH))))


def plausible(category: float, mask: float, psnr: float) -> float:
    """Return a factor on a camera's confidence, 0..1, that does not compare it with other cameras.

    Args:
        category: probability that the photo shows the model's category; from 0.5 on, it does not lower the factor.
        mask: probability that the mask is the object.
        psnr: of the render against the photo, dB.

    Example:
        >>> [round(plausible(*doubt, 30.0), 3) for doubt in ((0.9, 1.0), (0.25, 1.0), (1.0, 0.0))]
        [1.0, 0.5, 0.5]
    """
    return min(1.0, category / DOUBTFUL) * (_WRONG_MASK_FACTOR + (1 - _WRONG_MASK_FACTOR) * mask) * explained(psnr)


def _relative_margin(margin: float) -> float:
    """Return the fraction of the runner-up's loss that the winner saves; it saturates at 1 for large margins."""
    return -math.expm1(-max(margin, _MIN_MARGIN))


def _log_uncertainty(uncertainty: float) -> float:
    return math.log(max(uncertainty, _MIN_UNCERTAINTY))


def fit_calibration(margins: Sequence[float], uncertainties: Sequence[float], right: Sequence[bool]) -> Calibration:
    """Fit a logistic regression by Newton's method, with a small ridge on the standardised weights.

    Args:
        margins, uncertainties, right: one per fit, as for :func:`confidence`.

    Raises ``ValueError`` unless some fits are right and some wrong.
    """
    if len(set(right)) < 2:
        raise ValueError("a calibration needs fits that are right and fits that are wrong")
    columns = [*map(_relative_margin, margins)], [*map(_log_uncertainty, uncertainties)]
    values = np.column_stack(columns).astype(np.float64)
    truth = np.asarray(right, np.float64)
    mean = values.mean(0)
    scale = values.std(0) + 1e-9
    terms = np.column_stack((np.ones(len(values)), (values - mean) / scale))
    ridge = np.diag([1e-9, _RIDGE, _RIDGE])
    weights = np.zeros(3)
    for _ in range(50):
        probability = 1 / (1 + np.exp(-np.clip(terms @ weights, -30, 30)))
        hessian = terms.T @ (terms * (probability * (1 - probability))[:, None]) + ridge
        weights += np.linalg.solve(hessian, terms.T @ (truth - probability) - ridge @ weights)
    unscaled = weights[1:] / scale
    return Calibration(float(weights[0] - unscaled @ mean), *unscaled.tolist())


def auroc(scores: Sequence[float], right: Sequence[bool]) -> float:
    """Return the area under the ROC curve: the probability that a right fit scores above a wrong one.

    Ties count half. NaN without a right or without a wrong fit.

    Example:
        >>> auroc([0.9, 0.8, 0.3], [True, True, False])
        1.0
    """
    values = np.asarray(scores)
    truth = np.asarray(right, bool)
    differences = values[truth][:, None] - values[~truth]
    return float(((differences > 0) + 0.5 * (differences == 0)).mean()) if differences.size else math.nan
