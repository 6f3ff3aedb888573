import math

import numpy as np
import pytest

from core.lab.evaluation.statistics import mean_of


def test_a_bootstrap_interval_is_that_of_the_textbook():
    values = np.random.default_rng(1).normal(25, 2, 400)
    found = mean_of(values.tolist())
    half = 1.96 * values.std(ddof=1) / math.sqrt(len(values))
    assert found.mean == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - half, abs=0.05)
    assert found.high == pytest.approx(values.mean() + half, abs=0.05)
    assert found == mean_of(values.tolist())
    assert math.isnan(mean_of([]).mean)
