from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.benchmarks import robustness
from core.benchmarks.charts import read_robustness, write_robustness
from core.benchmarks.robustness import RobustnessResults, name_camera, run
from core.benchmarks.stressors import STRESSORS, Stressor
from core.benchmarks.tables import robustness_table
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep
from core.geometry.camera import Camera
from core.metrics import rotation_error
from core.models.model import Model
from tests.conftest import image_size
from tests.core.tiny import tiny_model

QUICK = {
    "normal": FitSettings(hypotheses=8, steps=60, rays=128, samples=24),
    "paper": replace(PRESETS["paper"], steps=10, rays=64, samples=16),
}


def test_a_wrong_camera_is_named_by_where_it_ended():
    truth = tiny_model().camera(0.4, 0.3)
    assert name_camera(truth, truth) == "correct"
    assert name_camera(replace(truth, azimuth=0.6), truth) == "near"
    assert name_camera(replace(truth, azimuth=0.4 - 3.1), truth) == "opposite"
    assert name_camera(replace(truth, azimuth=2.0), truth) == "wrong"


def test_only_the_paper_is_given_an_initial_camera(monkeypatch: pytest.MonkeyPatch):
    some = STRESSORS["initial error"]._replace(levels=(0.0, 90.0))
    monkeypatch.setattr(robustness, "STRESSORS", {"initial error": some})
    began, fit = list[Camera | None](), robustness.fit

    def watched(model: Model, job: FitJob) -> Iterator[FitStep]:
        began.append(job.resume_from.cameras[0] if job.resume_from else None)
        return fit(model, job)

    monkeypatch.setattr(robustness, "fit", watched)
    *_, found = run(tiny_model(), 1, presets=QUICK)
    assert isinstance(found, RobustnessResults)
    assert [one is None for one in began] == [True, False, True, False]
    assert rotation_error(began[1], began[3]) == pytest.approx(90)
    near, far = (trial.rotation for trial in found.trials if trial.preset == "paper")
    assert near < far


@pytest.fixture(scope="module")
def found() -> RobustnessResults:
    some = {name: STRESSORS[name]._replace(levels=STRESSORS[name].levels[:1]) for name in ("none", "elevation")}
    some |= {name: STRESSORS[name]._replace(levels=(0.0,)) for name in ("random pixels", "another category")}
    some["hidden"] = Stressor("", (1.0,), lambda image, *_: np.ones_like(image[..., :3]))
    patch = pytest.MonkeyPatch()
    with patch.context() as changed:
        changed.setattr(robustness, "STRESSORS", some)
        *lines, found = run(tiny_model(), 1, presets=QUICK)
    assert all(isinstance(line, str) for line in lines)
    assert isinstance(found, RobustnessResults)
    return found


def test_every_level_is_tried_and_a_refused_image_is_a_failure_with_its_reason(found: RobustnessResults):
    assert [name for name, _ in found.success_rates()] == [
        "none",
        "elevation",
        "random pixels",
        "another category",
        "hidden",
    ]
    assert found.success_rates()["hidden", 1.0] == {"normal": 0.0, "paper": 0.0}
    assert found.trials[0].outcome in ("correct", "near")
    assert all("no object" in trial.outcome for trial in found.trials if trial.stressor == "hidden")
    assert all(trial.rotation is not None for trial in found.trials if trial.stressor in ("none", "elevation"))


def test_where_there_is_no_object_it_must_be_refused_or_doubted(found: RobustnessResults):
    some = [trial for trial in found.trials if trial.stressor in ("random pixels", "another category")]
    assert {trial.outcome for trial in some} <= {"refused", "doubted", "believed"}
    assert {failure.trial for failure in found.failures} == {trial for trial in found.trials if not trial.success}
    assert all(trial.success == (trial.outcome != "believed") for trial in some)


def test_charts_are_written(found: RobustnessResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(STRESSORS, "hidden", Stressor("", (1.0,)))
    write_robustness(found, tmp_path)
    assert read_robustness(tmp_path / "robustness.csv").trials == found.trials
    assert image_size(tmp_path / "robustness.png")[0] > 400
    table = robustness_table(found)
    assert (tmp_path / "robustness.md").read_text() == table
    assert "| hidden | 1 | normal | stool0 |" in table
    assert "look the same from there: none." in table
    alike = replace(found, trials=tuple(replace(trial, outcome="symmetric") for trial in found.trials))
    assert "look the same from there: stool0." in robustness_table(alike)
    assert image_size(tmp_path / "failures.png")[0] > 400
