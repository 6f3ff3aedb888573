import math

import numpy as np
import pytest

from core.confidence import Calibration, Evidence, calibrated, confidence, separation


def fits(count: int) -> tuple[list[Evidence], list[bool]]:
    """Evidence whose odds are known."""
    numbers = np.random.default_rng(0)
    evidence = [Evidence(*values) for values in numbers.normal((0.5, 25, 0.5), (0.5, 3, 0.2), (count, 3)).tolist()]
    odds = [1 + 4 * (one.margin - 0.5) + 0.3 * (one.psnr - 25) for one in evidence]
    chances = numbers.random(count).tolist()
    return evidence, [chance < 1 / (1 + math.exp(-odd)) for chance, odd in zip(chances, odds, strict=True)]


def test_a_calibration_finds_the_odds_that_made_the_fits():
    found = calibrated(*fits(5000))
    assert found.margin == pytest.approx(4, abs=0.5)
    assert found.psnr == pytest.approx(0.3, abs=0.05)
    assert found.unlikely == pytest.approx(0, abs=0.5)


def test_confidence_is_a_probability_that_comes_true():
    evidence, right = fits(5000)
    by = calibrated(evidence, right)
    sure = np.array([confidence(one, by) for one in evidence])
    assert sure.min() >= 0
    assert sure.max() <= 1
    for low, high in ((0.2, 0.5), (0.5, 0.8), (0.8, 1.0)):
        some = (sure >= low) & (sure < high)
        assert np.asarray(right)[some].mean() == pytest.approx(sure[some].mean(), abs=0.06)


def test_separable_fits_have_a_finite_calibration():
    evidence = [Evidence(margin, 25.0, 0.5) for margin in (0.0, 0.1, 0.8, 0.9)]
    found = calibrated(evidence, [False, False, True, True])
    assert all(map(math.isfinite, found))
    assert confidence(evidence[0], found) < 0.5 < confidence(evidence[3], found)


def test_fits_of_one_kind_cannot_be_calibrated():
    with pytest.raises(ValueError, match="right and fits that are wrong"):
        calibrated([Evidence(1.0, 20.0, 1.0)] * 3, [True] * 3)
    assert math.isnan(separation([1.0, 2.0], [True, True]))


def test_a_wider_margin_and_a_better_picture_are_trusted_more():
    assert confidence(Evidence(0.0, 25.0, 0.7)) < confidence(Evidence(1.0, 25.0, 0.7))
    assert confidence(Evidence(-1e9, 0.0, 0.0), Calibration(0, 1, 0, 0)) >= 0
