"""How far to trust a fitted camera: the probability that it is right, from what the fit itself knows.

Wrong cameras are mostly those of another basin (the front/back twin above all) that explains the picture about as
well. The numbers below are a logistic regression over fits of held-out renders, whose cameras are known:
``python -m core bench fit --dataset TEST_SET`` makes them anew and tells how well they separate.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

RIGHT_DEGREES = 10.0
"""A camera that is turned by less is right: it is in the right basin, and the rest is a matter of precision."""
DOUBTFUL = 0.5
"""A camera of less confidence is more likely wrong than right."""
_RIDGE = 1.0
"""Keeps the weights of separable fits finite: a pseudo-observation each, in standard deviations."""


class Evidence(NamedTuple):
    """What a fit knows about its own camera."""

    margin: float
    """logarithm of the objective of the best hypothesis of another basin over the winner's, on the same rays"""
    psnr: float
    """dB, of the whole pictures"""
    unlikely: float
    """root mean square of the codes' numbers in standard deviations of the trained codes"""


class Calibration(NamedTuple):
    """The logarithm of the odds of a right camera: a constant, and what each kind of evidence adds."""

    constant: float
    margin: float
    psnr: float
    unlikely: float


CALIBRATION = Calibration(-1.0, 4.0, 0.0, 0.0)
"""A first guess."""


def confidence(evidence: Evidence, by: Calibration = CALIBRATION) -> float:
    """The probability that a fitted camera is right, 0..1.

    Example:
        >>> confidence(Evidence(math.log(3.0), 30.0, 1.0), Calibration(0.0, 1.0, 0.0, 0.0))
        0.75
    """
    odds = by.constant + sum(weight * value for weight, value in zip(by[1:], evidence, strict=True))
    return round(1 / (1 + math.exp(-max(-30.0, min(30.0, odds)))), 6)


def calibrated(evidence: Sequence[Evidence], right: Sequence[bool]) -> Calibration:
    """Logistic regression with a small ridge (Newton's method), on evidence in its own standard deviations.

    Raises ``ValueError`` where the fits are not both right and wrong.
    """
    if len(set(right)) < 2:
        raise ValueError("a calibration needs fits that are right and fits that are wrong")
    values, truth = np.asarray(evidence, np.float64), np.asarray(right, np.float64)
    mean, spread = values.mean(0), values.std(0) + 1e-9
    terms = np.column_stack((np.ones(len(values)), (values - mean) / spread))
    ridge = _RIDGE * np.diag([0.0, 1.0, 1.0, 1.0])
    weights = np.zeros(4)
    for _ in range(50):
        share = 1 / (1 + np.exp(-np.clip(terms @ weights, -30, 30)))
        bend = terms.T @ (terms * (share * (1 - share))[:, None]) + ridge + 1e-9 * np.eye(4)
        weights += np.linalg.solve(bend, terms.T @ (truth - share) - ridge @ weights)
    slopes = weights[1:] / spread
    return Calibration(*(float(number) for number in (weights[0] - slopes @ mean, *slopes)))


def separation(scores: Sequence[float], right: Sequence[bool]) -> float:
    """The chance that a right fit scores above a wrong one (AUROC), ties counting half; NaN where one kind lacks.

    Example:
        >>> separation([0.9, 0.8, 0.3], [True, True, False])
        1.0
    """
    values, truth = np.asarray(scores), np.asarray(right, bool)
    above = values[truth][:, None] - values[~truth]
    return float(((above > 0) + 0.5 * (above == 0)).mean()) if above.size else math.nan
