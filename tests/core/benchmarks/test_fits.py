import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image

from core.benchmarks import fits as fitting
from core.benchmarks import held_out_views as subjects
from core.benchmarks.charts import fitting_table, prepare, write_fitting
from core.benchmarks.fits import Measured, measured
from core.benchmarks.held_out_views import OTHERS, anywhere, looks_alike, own_subjects
from core.fitting.confidence import confidence
from core.fitting.fit import PRESETS, FitSettings
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.tiny import tiny_model

QUICK = {
    "normal": FitSettings(hypotheses=6, steps=40, rays=96, samples=20),
    "paper": replace(PRESETS["paper"], steps=20, rays=64, samples=16),
}


@pytest.fixture(scope="module")
def found() -> Measured:
    subjects = tuple(own_subjects(tiny_model(), 2, torch.Generator().manual_seed(0)))
    *told, found = measured(tiny_model(), subjects, QUICK)
    assert all(isinstance(line, str) for line in told)
    assert isinstance(found, Measured)
    return found


def test_subjects_are_pictures_of_objects_from_the_upper_half():
    model = tiny_model()
    subjects = tuple(own_subjects(model, 2, torch.Generator().manual_seed(1)))
    assert [subject.views.name for subject in subjects] == ["stool0", "stool2"]
    for subject, codes in zip(subjects, (model.codes[0], model.codes[2]), strict=True):
        assert len(subject.views.cameras) == 1 + OTHERS
        exact = render_exact(model, codes, subject.camera, 96).colour.clamp(0, 1)
        assert psnr(torch.from_numpy(subject.views.images[subject.view]) / 255, exact) > 35
        assert 0.01 < subject.views.masks[subject.view].mean() < 0.9
    generator = torch.Generator().manual_seed(0)
    heights = [math.sin(anywhere(model, generator).elevation) for _ in range(300)]
    assert min(heights) >= 0
    assert sum(heights) / len(heights) == pytest.approx(0.5, abs=0.05)


def test_a_model_that_paints_its_ground_has_subjects_too():
    subject, *_ = own_subjects(random_model(1, True), 1, torch.Generator().manual_seed(0))
    assert subject.views.images.shape[-1] == 3


def test_every_preset_fits_every_view_and_is_read_by_its_own_clock(found: Measured):
    assert [(trial.preset, trial.name) for trial in found.trials] == [
        (preset, name) for name in ("stool0", "stool2") for preset in QUICK
    ]
    for trial in found.trials:
        assert trial.trace[-1] in (trial.first_rotation, trial.rotation) or trial.seconds > fitting.TIMES[-1]
        assert trial.held_out > 5
        if trial.preset == "paper":
            assert trial.margin is trial.uncertainty is trial.confidence is None
        else:
            assert trial.margin is not None
            assert trial.uncertainty is not None
            assert trial.confidence == confidence(trial.margin, trial.uncertainty)
    assert [summary.preset for summary in found.summaries] == list(QUICK)
    assert {summary.fits for summary in found.summaries} == {2}
    assert all(one.separation is None or 0 <= one.separation <= 1 for one in found.summaries)


def test_charts_are_written(found: Measured, tmp_path: Path):
    prepare(tmp_path / "charts")
    write_fitting(found, tmp_path / "charts")
    told = json.loads((tmp_path / "charts/fit.json").read_text())
    assert [one["preset"] for one in told["summaries"]] == list(QUICK)
    assert Image.open(tmp_path / "charts/fit.png").width > 800
    table = fitting_table(found)
    assert (tmp_path / "charts/fit.md").read_text() == table
    assert "| paper |" in table


def test_fits_that_end_before_anything_is_read_off_are_drawn_too(found: Measured, tmp_path: Path) -> None:
    at_once = tuple(replace(one, seconds=1e-3, rotation=0.0) for one in found.summaries)
    write_fitting(replace(found, summaries=at_once), tmp_path)
    assert (tmp_path / "fit.png").exists()


def test_an_object_looks_alike_from_its_other_right_cameras_only(monkeypatch: pytest.MonkeyPatch):
    model, truth = tiny_model(), tiny_model().camera(0.7, 0.4)
    lopsided = model.codes[0]
    assert looks_alike(model, lopsided, replace(truth, azimuth=0.75), truth, 5.0)
    assert not looks_alike(model, lopsided, replace(truth, azimuth=0.7 + math.pi), truth, 5.0)
    plain = subjects.drawn_on_white

    def symmetric(model: Model, codes: Codes, camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
        return plain(model, codes, replace(camera, azimuth=camera.azimuth % math.pi))

    monkeypatch.setattr(subjects, "drawn_on_white", symmetric)
    assert looks_alike(model, lopsided, replace(truth, azimuth=0.71 + math.pi), truth, 5.0)
    assert not looks_alike(model, lopsided, replace(truth, azimuth=0.7 + math.pi / 2), truth, 5.0)
