"""How far to trust a fitted camera: the probability that it is right, from what the fit itself knows.

Wrong cameras are mostly those of another basin (the opposite view above all) that explains the photo about as well. So
a fit keeps the best hypothesis of another basin, the runner-up, and the margin between the two says how clear the
choice was: by the share of the runner-up's loss that the winner saves. Some wrong cameras lie in no basin: the model
cannot explain the photo. Their loss itself is high, the objective is flat, and its curvature says how uncertain the
camera is. Where two searches were run and agree, the smaller margin counts. The three numbers below are a logistic
regression over fits of renders, whose cameras are known: ``python -m core bench fit --dataset TEST_SET`` makes them
anew and tells how well the confidence separates right from wrong.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

RIGHT_DEGREES = 10.0
"""A camera that is turned by less is right: it is in the right basin, and the rest is a matter of precision."""
DOUBTFUL = 0.5  # A camera of less confidence is more likely wrong than right.
SURE = 0.9  # Nearly all cameras of more confidence were right.
_RIDGE = 0.1  # Keeps the weights finite where they separate all fits.
_MIN_UNCERTAINTY = 0.01  # degrees
_MIN_MARGIN = -30.0  # keeps the relative margin of a hypothesis that has lost finite


_EXPLAINED_PSNR, _EXPLAINED_WIDTH = 20.0, 1.0
"""dB: a render that is further from its photo does not explain it. The 116 right fits of 120 held-out views have 23.7
and more, right fits of 7 real photographs 21.7 and more; the one that is wrong, of a squashed car, has 18."""


_RIGHT_ANYHOW = 0.5
"""What is left of a confidence where the mask is surely not the object: a guess, not calibrated. On 26 photographs no
wrong camera has more than 0.79 by it, where two had 0.87 and 0.97."""


_WITNESS_DEGREES = 30.0  # Azimuths that differ by less agree.
_AGREES, _MIRRORED, _CONTRADICTS = 0.7, -0.3, -1.2
"""Logarithms of the odds that a camera is right, by what a second witness tells of its azimuth."""


class Calibration(NamedTuple):
    """The logarithm of the odds of a right camera: a constant, and the weights of the relative margin and of the
    logarithm of the uncertainty.
    """

    constant: float
    margin: float
    uncertainty: float


CALIBRATION = Calibration(0.14, 6.97, -1.55)
"""Of the shipped chairs and cars together: 216 blind fits by ``normal``, 120 of them of held-out objects, before a
restart lowered their margins. On the 184 of them that were fitted again since then, 6 of them wrong, the confidence
has an AUROC of 0.96.
"""


def confidence(margin: float, uncertainty: float, by: Calibration = CALIBRATION, witness: float = 0.0) -> float:
    """The probability that a fitted camera is right, 0..1.

    Args:
        margin: the logarithm of the loss of the runner-up over that of the winner.
        uncertainty: degrees that the winner may be off within its basin.
        witness: as :func:`witness_odds` has it.

    Example:
        >>> confidence(math.log(2), 1.0, Calibration(-2.0, 4.0, -1.0))
        0.5
    """
    odds = by.constant + by.margin * _relative_margin(margin) + by.uncertainty * _log_uncertainty(uncertainty)
    odds += witness
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, odds))))


def witness_odds(told: tuple[float, float] | None, azimuth: float) -> float:
    """Return what a second witness adds to the logarithm of the odds that a camera's azimuth (rad) is right.

    Args:
        told: the azimuth and elevation of the witness (rad); None where there is none.

    Example:
        >>> [witness_odds(told and (told, 0.3), 1.0) for told in (1.2, -1.2, 2.5, None)]
        [0.7, -0.3, -1.2, 0.0]
    """
    if told is None:
        return 0.0
    near = math.cos(math.radians(_WITNESS_DEGREES))
    if math.cos(azimuth - told[0]) > near:
        return _AGREES
    return _MIRRORED if math.cos(azimuth + told[0]) > near else _CONTRADICTS


def in_words(confidence: float) -> Literal["doubtful", "likely", "sure"]:
    """A confidence of 0..1, in a word."""
    if confidence < DOUBTFUL:
        return "doubtful"
    return "sure" if confidence > SURE else "likely"


def explained(psnr: float) -> float:
    """How far a render explains its photo, 0..1, by their PSNR (dB): no camera is right that explains nothing.

    Example:
        >>> round(explained(30.0), 3), round(explained(20.0), 3), round(explained(15.0), 3)
        (1.0, 0.5, 0.007)
    """
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, (psnr - _EXPLAINED_PSNR) / _EXPLAINED_WIDTH))))


def plausible(category: float, cut_out: float, psnr: float) -> float:
    """How far a camera can be right at all, 0..1, however clear it is among others.

    Args:
        category: the probability that the photo shows the model's category; likelier than not is not doubted.
        cut_out: the probability that the mask is the object.
        psnr: dB, between render and photo.

    Example:
        >>> [round(plausible(*doubt, 30.0), 3) for doubt in ((0.9, 1.0), (0.25, 1.0), (1.0, 0.0))]
        [1.0, 0.5, 0.5]
    """
    return min(1.0, category / DOUBTFUL) * (_RIGHT_ANYHOW + (1 - _RIGHT_ANYHOW) * cut_out) * explained(psnr)


def _relative_margin(margin: float) -> float:
    """The share of the runner-up's loss that the winner saves, at most 1: ten times worse is hardly clearer than
    thrice.
    """
    return -math.expm1(-max(margin, _MIN_MARGIN))


def _log_uncertainty(uncertainty: float) -> float:
    return math.log(max(uncertainty, _MIN_UNCERTAINTY))


def fit_calibration(margins: Sequence[float], uncertainties: Sequence[float], right: Sequence[bool]) -> Calibration:
    """Logistic regression by Newton's method, with a small ridge on the weights per standard deviation.

    Raises ``ValueError`` where the fits are not both right and wrong.
    """
    if len(set(right)) < 2:
        raise ValueError("a calibration needs fits that are right and fits that are wrong")
    values = np.column_stack(([*map(_relative_margin, margins)], [*map(_log_uncertainty, uncertainties)])).astype(
        np.float64
    )
    truth = np.asarray(right, np.float64)
    mean, scale = values.mean(0), values.std(0) + 1e-9
    terms = np.column_stack((np.ones(len(values)), (values - mean) / scale))
    ridge, weights = np.diag([1e-9, _RIDGE, _RIDGE]), np.zeros(3)
    for _ in range(50):
        share = 1 / (1 + np.exp(-np.clip(terms @ weights, -30, 30)))
        hessian = terms.T @ (terms * (share * (1 - share))[:, None]) + ridge
        weights += np.linalg.solve(hessian, terms.T @ (truth - share) - ridge @ weights)
    unscaled = weights[1:] / scale
    return Calibration(float(weights[0] - unscaled @ mean), *unscaled.tolist())


def auroc(scores: Sequence[float], right: Sequence[bool]) -> float:
    """The chance that a right fit scores above a wrong one (area under the ROC curve), ties counting half.

    NaN where one kind lacks.

    Example:
        >>> auroc([0.9, 0.8, 0.3], [True, True, False])
        1.0
    """
    values, truth = np.asarray(scores), np.asarray(right, bool)
    above = values[truth][:, None] - values[~truth]
    return float(((above > 0) + 0.5 * (above == 0)).mean()) if above.size else math.nan
