import math

import numpy as np
import pytest

from core.fitting.confidence import DOUBTFUL, Calibration, auroc, confidence, fit_calibration, in_words, plausible


def fits(count: int) -> tuple[list[float], list[float], list[bool]]:
    """Margins and uncertainties whose odds are known."""
    numbers = np.random.default_rng(0)
    margins = np.abs(numbers.normal(0, 0.8, count)).tolist()
    uncertainties = np.exp(numbers.normal(0, 0.7, count)).tolist()
    chances = numbers.random(count).tolist()
    truth = Calibration(-1.0, 4.0, -1.5)
    right = [chance < confidence(*pair, truth) for chance, *pair in zip(chances, margins, uncertainties, strict=True)]
    return margins, uncertainties, right


def test_a_calibration_recovers_the_odds_and_predicts_frequencies():
    calibration = fit_calibration(*fits(5000))
    assert calibration.constant == pytest.approx(-1, abs=0.3)
    assert calibration.margin == pytest.approx(4, abs=0.6)
    assert calibration.uncertainty == pytest.approx(-1.5, abs=0.3)
    margins, uncertainties, right = fits(5000)
    calibration = fit_calibration(margins, uncertainties, right)
    confidences = np.array([confidence(*pair, calibration) for pair in zip(margins, uncertainties, strict=True)])
    for low, high in ((0.2, 0.5), (0.5, 0.8), (0.8, 1.0)):
        in_bin = (confidences >= low) & (confidences < high)
        assert np.asarray(right)[in_bin].mean() == pytest.approx(confidences[in_bin].mean(), abs=0.06)


def test_separable_fits_are_calibrated_and_fits_of_one_outcome_are_refused():
    calibration = fit_calibration([0.0, 0.1, 0.8, 0.9], [1.0, 1.0, 1.0, 1.0], [False, False, True, True])
    assert all(map(math.isfinite, calibration))
    assert confidence(0.0, 1.0, calibration) < 0.5 < confidence(0.9, 1.0, calibration)
    with pytest.raises(ValueError, match="right and fits that are wrong"):
        fit_calibration([1.0] * 3, [1.0] * 3, [True] * 3)
    assert math.isnan(auroc([1.0, 2.0], [True, True]))


def test_confidence_grows_with_margin_and_plausibility():
    assert confidence(0.0, 1.5) < DOUBTFUL < confidence(1.0, 1.0)
    assert confidence(0.5, 20.0) < confidence(0.5, 1.0)
    assert 0 <= confidence(-1e9, 0.0) < confidence(1e9, 180.0) <= 1
    assert plausible(0.6, 1.0, 40.0) == plausible(1.0, 1.0, 40.0) > 0.99
    assert plausible(0.2, 1.0, 40.0) < 0.5
    assert 0.3 < plausible(1.0, 0.0, 40.0) < plausible(1.0, 0.5, 40.0) < plausible(1.0, 1.0, 40.0)
    assert plausible(1.0, 1.0, 10.0) < 0.01


@pytest.mark.parametrize(("confidence", "words"), [(0.95, "sure"), (0.9, "likely"), (0.5, "likely"), (0.2, "doubtful")])
def test_confidence_has_words(confidence: float, words: str):
    assert in_words(confidence) == words
