from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.fitting.confidence import confidence, explained
from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks import fits
from core.lab.benchmarks.charts import redraw
from core.lab.benchmarks.fits import KEY, FitMethod, FitTrial, fit_views, summarise_presets
from core.lab.benchmarks.held_out_views import training_object_views
from core.lab.benchmarks.results import frame_of, keys_of, write_frame
from core.lab.datasets.srn import ObjectViews
from core.models.model import Model
from tests.conftest import image_size

QUICK = {
    "normal": FitSettings(hypotheses=6, steps=40, rays=96, samples=20, free_steps=0),  # confidence precedes that stage
    "paper": replace(PRESETS["paper"], steps=20, rays=64, samples=16),
}


@pytest.fixture(scope="module")
def trials(tiny: Model) -> tuple[FitTrial, ...]:
    first, second = training_object_views(tiny, 2, torch.Generator().manual_seed(0))
    targets = replace(first, full_size=_enlarged(first.views)), second
    methods = {name: FitMethod(preset) for name, preset in QUICK.items()}
    trials = tuple(fit_views(tiny, targets, methods))
    assert list(fit_views(tiny, targets, methods, keys_of(frame_of(trials), KEY))) == []
    return trials


def _enlarged(views: ObjectViews) -> ObjectViews:
    """Return the views with four pixels in place of each."""
    cameras = tuple(camera.resized(2 * camera.width, 2 * camera.height) for camera in views.cameras)
    images, masks = (pixels.repeat(2, 1).repeat(2, 2) for pixels in (views.images, views.masks))
    return replace(views, images=images, masks=masks, cameras=cameras)


def test_every_preset_fits_every_view_and_curves_follow_its_processor_time(trials: tuple[FitTrial, ...]):
    assert [(trial.preset, trial.name) for trial in trials] == [
        (preset, name) for name in ("stool0", "stool2") for preset in QUICK
    ]
    for trial in trials:
        assert trial.rotation_curve[-1] in (trial.initial_rotation, trial.rotation) or trial.seconds > fits.TIMES[-1]
        assert trial.held_out > 5
        if trial.preset == "paper":
            assert trial.margin is trial.uncertainty is trial.confidence is None
        else:
            assert trial.margin is not None
            assert trial.uncertainty is not None
            assert trial.confidence == confidence(trial.margin, trial.uncertainty) * explained(trial.psnr)
        assert trial.whole is not None and 0 < trial.whole.overlap <= 1 and 0 < trial.whole.haze < 1
        assert (trial.whole.psnr == trial.held_out) == (trial.name == "stool2")
    summaries = summarise_presets(frame_of(trials))
    assert summaries[0].whole is not None and summaries[0].whole.psnr > 5
    assert [summary.preset for summary in summaries] == list(QUICK)
    assert {summary.fits for summary in summaries} == {2}
    assert all(summary.auroc is None or 0 <= summary.auroc <= 1 for summary in summaries)


def test_charts_are_drawn_again_even_of_instant_fits(trials: tuple[FitTrial, ...], tmp_path: Path):
    with pytest.raises(ValueError, match="no CSV file of a benchmark"):
        redraw(tmp_path)
    (tmp_path / "charts").mkdir()
    instant_trials = [replace(trial, seconds=1e-3, rotation=0.0) for trial in trials]
    for path, rows in ((tmp_path / "charts/fit.csv", trials), (tmp_path / "fit.csv", instant_trials)):
        write_frame(path, frame_of(rows, {"machine": "a machine"}))
    assert redraw(tmp_path) == [tmp_path / "charts/fit.csv", tmp_path / "fit.csv"]
    assert image_size(tmp_path / "charts/fit.png")[0] > 800
    assert "| paper |" in (tmp_path / "charts/fit.md").read_text()
    assert (tmp_path / "fit.png").exists()
