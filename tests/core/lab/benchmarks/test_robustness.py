from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from core.fitting.fit import PRESETS
from core.lab.benchmarks import robustness
from core.lab.benchmarks.charts import draw
from core.lab.benchmarks.csv_files import Results, append_record, read_results
from core.lab.benchmarks.held_out_views import HeldOutView, training_object_views
from core.lab.benchmarks.robustness import RobustnessTrial, measure_robustness, name_camera, rough_rates, success_rates
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
    stressors = {name: STRESSORS[name]._replace(levels=STRESSORS[name].levels[:1]) for name in ("none", "elevation")}
    stressors |= {name: STRESSORS[name]._replace(levels=(0.0,)) for name in ("random pixels", "another category")}
    stressors["initial error"] = STRESSORS["initial error"]._replace(levels=(90.0,))
    stressors["hidden"] = Stressor("", (1.0,), lambda image, *_: np.ones_like(image[..., :3]))
    with pytest.MonkeyPatch.context() as changed:
        changed.setattr(robustness, "STRESSORS", stressors)
        changed.setattr(robustness, "PRESETS", QUICK_PRESETS)
        return list(measure_robustness(tiny, (view(),)))


def test_refusals_are_failures_only_with_an_object(trials: list[RobustnessTrial]):
    assert len({trial.key for trial in trials}) == len(trials) == 12
    assert trials[0].outcome in ("correct", "near")
    assert trials[0].size_error == pytest.approx(0, abs=0.3)
    assert all("no object" in trial.outcome for trial in trials if trial.stressor == "hidden")
    assert all(trial.rotation is not None for trial in trials if trial.stressor in ("none", "elevation"))
    without_object = [trial for trial in trials if trial.stressor in ("random pixels", "another category")]
    assert {trial.outcome for trial in without_object} <= {"refused", "doubted", "believed"}
    assert all(trial.success == (trial.outcome != "believed") for trial in without_object)


def test_a_paper_fit_starts_at_the_camera_of_the_stressor(trials: list[RobustnessTrial]):
    initial_errors = [trial for trial in trials if trial.stressor == "initial error"]
    (ours,) = (trial for trial in initial_errors if trial.preset == "normal")
    (paper,) = (trial for trial in initial_errors if trial.preset == "paper")
    assert paper.rotation is not None
    assert ours.rotation is not None
    assert paper.rotation > 40  # ten steps do not lead back from 90 degrees


def test_chunks_divide_all_trials_and_a_resumed_run_skips_done_ones(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(robustness, "PRESETS", QUICK_PRESETS)
    blank = {name: Stressor("", (0.0, 1.0), lambda image, *_: np.ones_like(image[..., :3])) for name in ("a", "b")}
    monkeypatch.setattr(robustness, "STRESSORS", blank)

    def keys(chunk: tuple[int, int], done: set[tuple[str, float, str, str]]) -> list[tuple[str, float, str, str]]:
        return [trial.key for trial in measure_robustness(tiny_model(), (view(),), chunk=chunk, done=done)]

    everything = keys((1, 1), set())
    odd = keys((1, 2), set())
    even = keys((2, 2), set())
    assert len(everything) == 8
    assert sorted(odd + even) == sorted(everything)
    assert keys((1, 1), set(odd)) == even
    with pytest.raises(ValueError, match="K of 1 to N"):
        keys((3, 2), set())
    with pytest.raises(ValueError, match="no 'c'"):
        next(measure_robustness(tiny_model(), (view(),), ["c"]))


def test_success_rates_have_intervals_at_two_angles():
    trials = tuple(
        RobustnessTrial("none", 0.0, "normal", f"{i}", rotation, sure, 0.02, "correct" if rotation < 10 else "near")
        for i, (rotation, sure) in enumerate(((1.0, 0.95), (2.0, 0.6), (20.0, 0.95), (60.0, 0.95)))
    )
    rate = success_rates(trials)["none", 0.0]["normal"]
    assert rate.mean == 0.5
    assert rate.low < 0.5 < rate.high
    assert rough_rates(trials)["none", 0.0]["normal"].mean == 0.75
    table = robustness_table(Results({"machine": "m"}, trials))
    assert "| none | 0 | 50 % (" in table
    assert "| 75 % | 2 | 2.0 % |" in table
    assert "Failures of normal: 2 near." in table
    assert "| 0.5 | 100 % | 50 % | 100 % |\n| 0.8 | 75 % | 67 % | 50 % |" in table


def test_charts_are_drawn_from_rows(trials: list[RobustnessTrial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(STRESSORS, "hidden", Stressor("", (1.0,)))
    for trial in trials:
        append_record(tmp_path / "robustness.csv", {"machine": "a machine, idle"}, trial)
    results = Results({"machine": "a machine, idle"}, tuple(trials))
    assert read_results(tmp_path / "robustness.csv", RobustnessTrial) == results
    assert draw(tmp_path, "robustness") == robustness_table(results)
    assert image_size(tmp_path / "robustness.png")[0] > 400
    assert (tmp_path / "robustness.md").read_text() == robustness_table(results)
