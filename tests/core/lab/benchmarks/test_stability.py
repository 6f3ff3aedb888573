from dataclasses import replace

import pandas as pd
import pytest

from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks.held_out_views import HeldOutView
from core.lab.benchmarks.results import frame_of
from core.lab.benchmarks.stability import StabilityTrial, cases, corrupted_photos, measure, wrong_and_sure
from core.lab.benchmarks.stressors import STRESSORS


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "normal", FitSettings(hypotheses=3, steps=12, rays=64, samples=16, free_steps=1))


@pytest.mark.parametrize(
    "case", ["holes 0.3, normal", "focal 0.75, normal", "intruder 1, normal", "stranger 1, normal"]
)
def test_corrupted_input_is_fitted_and_judged(view: HeldOutView, case: str):
    (trial,) = measure(view, case)
    assert f"{trial.stressor} {trial.level:g}, {trial.method}" == case
    assert trial.confidence is not None and trial.doubted == (trial.confidence < 0.5)
    if trial.stressor == "stranger":
        assert trial.right == trial.doubted and trial.rotation is None
    else:
        assert trial.right == (trial.rotation <= 10) or trial.stressor == "intruder"
        assert trial.novel > 5


def test_a_case_without_its_other_object_has_no_row(view: HeldOutView):
    alone = HeldOutView(view.model, view.views)
    assert measure(alone, "intruder 1, normal") == measure(alone, "stranger 1, normal") == ()


def test_an_image_without_an_object_is_refused(view: HeldOutView):
    empty = HeldOutView(view.model, replace(view.views, masks=view.views.masks & False))
    (trial,) = measure(empty, "noise 0.2, normal")
    assert trial.outcome.startswith("refused: ") and trial.doubted and not trial.right


def test_the_stated_focal_length_is_a_multiple_of_the_true_one(view: HeldOutView):
    photos = [corrupted_photos(view, STRESSORS["focal"], level)[0] for level in (1.0, 1.5)]
    assert photos[1].focal == pytest.approx(1.5 * photos[0].focal)
    assert corrupted_photos(view, STRESSORS["noise"], 0.1)[0].focal is None


def test_quick_cases_are_the_hardest_by_the_default():
    assert "occlusion 0.6, normal" in cases(True) and "occlusion 0.2, normal" not in cases(True)
    assert "stranger 1, paper" not in cases(False) and "occlusion 0.6, paper" in cases(False)
    assert len(cases(True)) == len(STRESSORS)


def test_a_refusal_is_not_wrong_and_sure():
    trial = StabilityTrial("chairs", "a", 0, "c", "blur", 1.0, "normal")
    trials = [trial, replace(trial, confidence=0.9), replace(trial, confidence=0.9, right=True)]
    assert wrong_and_sure(frame_of(trials), 0.8).tolist() == pd.Series([False, True, False]).tolist()
