"""How far to trust a fitted camera: the probability that it is right, from what the fit itself knows.

Wrong cameras are mostly those of another basin (the front/back twin above all) that explains the picture about as
well. So a fit keeps the best hypothesis of another basin to its end, and the margin between the two is what it knows
of its own camera. The two numbers below are a logistic regression over fits of renders, whose cameras are
known: ``python -m core bench fit --dataset TEST_SET`` makes them anew and tells how well the confidence separates.
(The PSNR of the fit and the norm of its codes were tried beside the margin; on objects left out they made it worse.)
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

RIGHT_DEGREES = 10.0
"""A camera that is turned by less is right: it is in the right basin, and the rest is a matter of precision."""
DOUBTFUL = 0.5
"""A camera of less confidence is more likely wrong than right."""
_RIDGE = 0.1
"""Keeps the slope finite where a margin separates all fits."""


class Calibration(NamedTuple):
    """The logarithm of the odds of a right camera: a constant, and what the margin adds."""

    constant: float
    margin: float


CALIBRATION = Calibration(-0.69, 5.46)
"""Of chairs and cars together: 80 blind fits by ``normal``, half of them of held-out objects, six of them wrong. On 82
others, four of them wrong, it told them apart with an AUROC of 0.97. Since fits forgive what the model cannot draw it
is 0.79 on 66 fits: of the six wrong ones two are off by 10 to 12 degrees, in the right basin.
"""


def confidence(margin: float, by: Calibration = CALIBRATION) -> float:
    """The probability that a fitted camera is right, 0..1.

    Args:
        margin: the logarithm of the objective of the best hypothesis of another basin over that of the winner.

    Example:
        >>> confidence(1.0, Calibration(-2.0, 2.0))
        0.5
    """
    odds = by.constant + by.margin * margin
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, odds))))


def calibrated(margins: Sequence[float], right: Sequence[bool]) -> Calibration:
    """Logistic regression by Newton's method, with a small ridge on the slope per standard deviation of margins.

    Raises ``ValueError`` where the fits are not both right and wrong.
    """
    if len(set(right)) < 2:
        raise ValueError("a calibration needs fits that are right and fits that are wrong")
    values, truth = np.asarray(margins, np.float64), np.asarray(right, np.float64)
    mean, spread = float(values.mean()), float(values.std()) + 1e-9
    terms = np.column_stack((np.ones(len(values)), (values - mean) / spread))
    ridge, weights = np.diag([1e-9, _RIDGE]), np.zeros(2)
    for _ in range(50):
        share = 1 / (1 + np.exp(-np.clip(terms @ weights, -30, 30)))
        bend = terms.T @ (terms * (share * (1 - share))[:, None]) + ridge
        weights += np.linalg.solve(bend, terms.T @ (truth - share) - ridge @ weights)
    slope = float(weights[1]) / spread
    return Calibration(float(weights[0]) - slope * mean, slope)


def separation(scores: Sequence[float], right: Sequence[bool]) -> float:
    """The chance that a right fit scores above a wrong one (AUROC), ties counting half; NaN where one kind lacks.

    Example:
        >>> separation([0.9, 0.8, 0.3], [True, True, False])
        1.0
    """
    values, truth = np.asarray(scores), np.asarray(right, bool)
    above = values[truth][:, None] - values[~truth]
    return float(((above > 0) + 0.5 * (above == 0)).mean()) if above.size else math.nan
