"""Means over objects with bootstrap intervals, and their formatting."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

_RESAMPLES = 2000


class Mean(NamedTuple):
    """A mean over objects with its 95 % interval (bootstrap over objects)."""

    mean: float
    low: float
    high: float


def mean_of(values: Collection[float]) -> Mean:
    """Return the mean and its deterministic bootstrap interval; NaN without values.

    Example:
        >>> mean_of([2.0, 2.0])
        Mean(mean=2.0, low=2.0, high=2.0)
    """
    if not len(values):
        return Mean(float("nan"), float("nan"), float("nan"))
    array = np.asarray(values, np.float64)
    resamples = np.random.default_rng(0).integers(0, len(array), (_RESAMPLES, len(array)))
    low, high = np.percentile(array[resamples].mean(1), (2.5, 97.5))
    return Mean(float(array.mean()), float(low), float(high))


def format_difference(difference: Mean) -> str:
    """Format a paired difference with its sign and its interval.

    Example:
        >>> format_difference(Mean(-1.0, -1.25, 0.0))
        '-1.00 (-1.25 to +0.00)'
    """
    return f"{difference.mean:+.2f} ({difference.low:+.2f} to {difference.high:+.2f})"
