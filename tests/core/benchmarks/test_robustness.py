import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.benchmarks import robustness as stability
from core.benchmarks.charts import stability_table, write_stability
from core.benchmarks.robustness import STRESSORS, Atlas, Stressor, _kind, measured
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep
from core.geometry.camera import Camera
from core.metrics import rotation_error
from core.models.model import Model
from tests.core.tiny import tiny_model

QUICK = {
    "normal": FitSettings(hypotheses=8, steps=60, rays=128, samples=24),
    "paper": replace(PRESETS["paper"], steps=10, rays=64, samples=16),
}


def cutout() -> np.ndarray:
    """An object of one colour on white."""
    picture = np.ones((40, 40, 4), np.float32)
    picture[..., 3] = 0
    picture[10:30, 12:28] = (0.2, 0.4, 0.6, 1)
    return picture


_OF_CAMERAS = ("initial error", "elevation", "focal length")


@pytest.mark.parametrize("name", [name for name in STRESSORS if name not in _OF_CAMERAS])
def test_a_worsened_picture_is_one_and_every_level_is_another(name: str):
    stressor = STRESSORS[name]
    made = [stressor.worsened(cutout(), level, np.random.default_rng(0)) for level in stressor.levels]
    for picture in made:
        assert picture.shape[-1] in (3, 4)
        assert picture.dtype == np.uint8 or 0 <= picture.min() <= picture.max() <= 1
    assert len({picture.tobytes() for picture in made}) == len(made)
    assert np.array_equal(made[0], cutout()) == (name in ("nothing", "another category"))


def test_occlusion_hides_its_share_and_masks_grow_and_shrink():
    area = cutout()[..., 3].sum()
    hidden = STRESSORS["occlusion"].worsened(cutout(), 0.5, np.random.default_rng(0))
    assert hidden[..., 3].sum() == pytest.approx(area / 2, abs=20)
    for pixels, sides in ((-2.0, (16, 12)), (2.0, (24, 20))):
        mask = STRESSORS["mask"].worsened(cutout(), pixels, np.random.default_rng(0))[..., 3]
        assert (int(mask.any(1).sum()), int(mask.any(0).sum())) == sides


def test_a_wrong_camera_is_named_by_where_it_ended():
    truth = tiny_model().camera(0.4, 0.3)
    assert _kind(truth, truth, 0.0) == "right"
    assert _kind(replace(truth, azimuth=0.6), truth, 11.0) == "near"
    assert _kind(replace(truth, azimuth=0.4 - 3.1), truth, 178.0) == "twin"
    assert _kind(replace(truth, azimuth=2.0), truth, 90.0) == "elsewhere"


def test_only_the_paper_is_told_where_to_begin(monkeypatch: pytest.MonkeyPatch):
    some = STRESSORS["initial error"]._replace(levels=(0.0, 90.0))
    monkeypatch.setattr(stability, "STRESSORS", {"initial error": some})
    began, fit = list[Camera | None](), stability.fit

    def watched(model: Model, job: FitJob) -> Iterator[FitStep]:
        began.append(job.resume_from.cameras[0] if job.resume_from else None)
        return fit(model, job)

    monkeypatch.setattr(stability, "fit", watched)
    *_, found = measured(tiny_model(), 1, presets=QUICK)
    assert isinstance(found, Atlas)
    assert [one is None for one in began] == [True, False, True, False]
    assert rotation_error(began[1], began[3]) == pytest.approx(90)
    near, far = (trial.rotation for trial in found.trials if trial.preset == "paper")
    assert near < far


@pytest.fixture(scope="module")
def found() -> Atlas:
    some = {name: STRESSORS[name]._replace(levels=STRESSORS[name].levels[:1]) for name in ("nothing", "elevation")}
    some |= {name: STRESSORS[name]._replace(levels=(0.0,)) for name in ("random pixels", "another category")}
    some["hidden"] = Stressor("", (1.0,), lambda picture, *_: np.ones_like(picture[..., :3]))
    patch = pytest.MonkeyPatch()
    with patch.context() as changed:
        changed.setattr(stability, "STRESSORS", some)
        *told, found = measured(tiny_model(), 1, presets=QUICK)
    assert all(isinstance(line, str) for line in told)
    assert isinstance(found, Atlas)
    return found


def test_every_cell_is_tried_and_a_refused_picture_is_a_failure_with_its_reason(found: Atlas):
    assert [name for name, _ in found.cells()] == [
        "nothing",
        "elevation",
        "random pixels",
        "another category",
        "hidden",
    ]
    assert found.cells()["hidden", 1.0] == {"normal": 0.0, "paper": 0.0}
    assert found.trials[0].ended in ("right", "near")
    assert all("no object" in trial.ended for trial in found.trials if trial.stressor == "hidden")
    assert all(trial.rotation is not None for trial in found.trials if trial.stressor in ("nothing", "elevation"))


def test_where_there_is_no_object_it_must_be_refused_or_doubted(found: Atlas):
    some = [trial for trial in found.trials if trial.stressor in ("random pixels", "another category")]
    assert {trial.ended for trial in some} <= {"refused", "doubted", "believed"}
    assert all(trial.success == (trial.ended != "believed") == (trial.seen is None) for trial in some)


def test_cameras_are_stressed_so_that_the_object_keeps_its_size():
    camera = tiny_model().camera(0.3, 0.2)
    far = STRESSORS["focal length"].viewed(camera, 1.3)
    assert far.focal / far.distance == pytest.approx(camera.focal / camera.distance)
    assert STRESSORS["elevation"].viewed(camera, 30.0).elevation == pytest.approx(0.5236, abs=1e-4)


def test_charts_are_written(found: Atlas, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(STRESSORS, "hidden", Stressor("", (1.0,)))
    write_stability(found, tmp_path)
    told = json.loads((tmp_path / "stability.json").read_text())
    assert len(told["failures"]) == sum(not trial.success for trial in found.trials)
    assert Image.open(tmp_path / "stability.png").width > 400
    table = stability_table(found)
    assert (tmp_path / "stability.md").read_text() == table
    assert "| hidden | 1 | normal | stool0 |" in table
    assert "look the same: none." in table
    alike = replace(found, trials=tuple(replace(trial, ended="symmetric") for trial in found.trials))
    assert "look the same: stool0." in stability_table(alike)
    assert Image.open(tmp_path / "failures.png").width > 400
