import math

import numpy as np
import pytest

from core.lab.evaluation.statistics import mean_of


def test_the_bootstrap_interval_matches_the_normal_one():
    values = np.random.default_rng(1).normal(25, 2, 400)
    mean = mean_of(values.tolist())
    half = 1.96 * values.std(ddof=1) / math.sqrt(len(values))
    assert mean.mean == pytest.approx(values.mean())
    assert mean.low == pytest.approx(values.mean() - half, abs=0.05)
    assert mean.high == pytest.approx(values.mean() + half, abs=0.05)
    assert mean == mean_of(values.tolist())
    assert math.isnan(mean_of([]).mean)
