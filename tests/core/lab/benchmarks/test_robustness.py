from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from core.fitting.fit import PRESETS
from core.lab.benchmarks import robustness
from core.lab.benchmarks.charts import draw
from core.lab.benchmarks.held_out_views import HeldOutView, training_object_views
from core.lab.benchmarks.results import append_row, frame_of, keys_of
from core.lab.benchmarks.robustness import (
    KEY,
    RobustnessTrial,
    measure_robustness,
    name_camera,
    rough_rates,
    success_rates,
    successes,
)
from core.lab.benchmarks.stressors import STRESSORS, Stressor
from core.lab.benchmarks.tables import robustness_table
from core.models.model import Model
from tests.conftest import image_size
from tests.core.fitting.inputs import QUICK
from tests.core.tiny import tiny_model

QUICK_PRESETS = {"normal": QUICK, "paper": replace(PRESETS["paper"], steps=10, rays=64, samples=16)}


def view() -> HeldOutView:
    (target,) = training_object_views(tiny_model(), 1, torch.Generator().manual_seed(0))
    return target


def test_cameras_are_classified_by_their_error():
    truth = tiny_model().camera(0.4, 0.3)
    assert name_camera(truth, truth) == "correct"
    assert name_camera(replace(truth, azimuth=0.7), truth) == "near"
    assert name_camera(replace(truth, azimuth=0.4 - 3.1), truth) == "opposite"
    assert name_camera(replace(truth, azimuth=2.0), truth) == "wrong"


@pytest.fixture(scope="module")
def trials(tiny: Model) -> list[RobustnessTrial]:
    """Trials of one object with every kind of outcome."""
    stressors = {name: STRESSORS[name]._replace(levels=STRESSORS[name].levels[:1]) for name in ("none", "frontal")}
    stressors["another category"] = STRESSORS["another category"]
    stressors["hidden"] = Stressor("", (1.0,), lambda image, *_: np.ones_like(image[..., :3]))
    with pytest.MonkeyPatch.context() as changed:
        changed.setattr(robustness, "STRESSORS", stressors)
        changed.setattr(robustness, "PRESETS", QUICK_PRESETS)
        return list(measure_robustness(tiny, (view(),)))


def test_refusals_are_failures_only_with_an_object(trials: list[RobustnessTrial]):
    assert len(keys_of(frame_of(trials), KEY)) == len(trials) == 8
    assert trials[0].outcome in ("correct", "near")
    assert trials[0].size_error == pytest.approx(0, abs=0.3)
    assert all("no object" in trial.outcome for trial in trials if trial.stressor == "hidden")
    assert all(trial.rotation is not None for trial in trials if trial.stressor in ("none", "frontal"))
    without_object = [trial for trial in trials if trial.stressor == "another category"]
    assert {trial.outcome for trial in without_object} <= {"refused", "doubted", "believed"}
    assert successes(frame_of(without_object)).tolist() == [trial.outcome != "believed" for trial in without_object]


def test_a_resumed_run_skips_done_trials_and_unknown_names_are_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(robustness, "PRESETS", QUICK_PRESETS)
    blank = {name: Stressor("", (0.0, 1.0), lambda image, *_: np.ones_like(image[..., :3])) for name in ("a", "b")}
    monkeypatch.setattr(robustness, "STRESSORS", blank)
    trials = frame_of(measure_robustness(tiny_model(), (view(),)))
    assert len(trials) == 8
    remaining = frame_of(measure_robustness(tiny_model(), (view(),), done=keys_of(trials[::2], KEY)))
    assert keys_of(remaining, KEY) == keys_of(trials[1::2], KEY)
    with pytest.raises(ValueError, match="no 'c'"):
        next(measure_robustness(tiny_model(), (view(),), ["c"]))


def test_success_rates_have_intervals_at_two_angles():
    trials = frame_of(
        (
            RobustnessTrial("none", 0.0, "normal", f"{i}", rotation, sure, 0.02, "correct" if rotation < 10 else "near")
            for i, (rotation, sure) in enumerate(((1.0, 0.95), (2.0, 0.6), (20.0, 0.95), (60.0, 0.95)))
        ),
        {"machine": "m"},
    )
    rate = success_rates(trials)["none", 0.0, "normal"]
    assert rate.mean == 0.5
    assert rate.low < 0.5 < rate.high
    assert rough_rates(trials)["none", 0.0, "normal"].mean == 0.75
    table = robustness_table(trials)
    assert "| none | 0 | 50 % (" in table
    assert "| 75 % | 2 | 2.0 % |" in table
    assert "Failures of normal: 2 near." in table
    assert "| 0.5 | 100 % | 50 % | 100 % |\n| 0.8 | 75 % | 67 % | 50 % |" in table


def test_charts_are_drawn_from_rows(trials: list[RobustnessTrial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(STRESSORS, "hidden", Stressor("", (1.0,)))
    conditions = {"machine": "a machine, idle"}
    for trial in trials:
        append_row(tmp_path / "robustness.csv", conditions, trial)
    table = draw(tmp_path, "robustness")
    assert table == robustness_table(frame_of(trials, conditions)) == (tmp_path / "robustness.md").read_text()
    assert image_size(tmp_path / "robustness.png")[0] > 400
