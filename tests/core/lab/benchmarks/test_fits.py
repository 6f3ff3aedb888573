from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.fitting.confidence import confidence, explained
from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks import fits
from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.csv_files import Results, read_results
from core.lab.benchmarks.drawing import prepare
from core.lab.benchmarks.fits import FitMethod, FitTrial, fit_views, summarise_presets
from core.lab.benchmarks.held_out_views import training_object_views
from core.lab.datasets.srn import ObjectViews
from core.models.model import Model
from tests.conftest import image_size

QUICK = {
    "normal": FitSettings(hypotheses=6, steps=40, rays=96, samples=20),
    "paper": replace(PRESETS["paper"], steps=20, rays=64, samples=16),
}


@pytest.fixture(scope="module")
def results(tiny: Model) -> Results[FitTrial]:
    first, second = training_object_views(tiny, 2, torch.Generator().manual_seed(0))
    targets = replace(first, full_size=_enlarged(first.views)), second
    methods = {name: FitMethod(preset) for name, preset in QUICK.items()}
    trials = tuple(fit_views(tiny, targets, methods))
    assert list(fit_views(tiny, targets, methods, {trial.key for trial in trials})) == []
    return Results({"machine": "a machine"}, trials)


def _enlarged(views: ObjectViews) -> ObjectViews:
    """Return the views with four pixels in place of each."""
    cameras = tuple(camera.resized(2 * camera.width, 2 * camera.height) for camera in views.cameras)
    images, masks = (pixels.repeat(2, 1).repeat(2, 2) for pixels in (views.images, views.masks))
    return replace(views, images=images, masks=masks, cameras=cameras)


def test_every_preset_fits_every_view_and_curves_follow_its_processor_time(results: Results[FitTrial]):
    assert [(trial.preset, trial.name) for trial in results.rows] == [
        (preset, name) for name in ("stool0", "stool2") for preset in QUICK
    ]
    for trial in results.rows:
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
    summaries = summarise_presets(results.rows)
    assert summaries[0].whole is not None and summaries[0].whole.psnr > 5
    assert [summary.preset for summary in summaries] == list(QUICK)
    assert {summary.fits for summary in summaries} == {2}
    assert all(summary.auroc is None or 0 <= summary.auroc <= 1 for summary in summaries)


def test_charts_are_written_even_of_instant_fits(results: Results[FitTrial], tmp_path: Path):
    with pytest.raises(ValueError, match="no CSV file of a benchmark"):
        redraw(tmp_path)
    prepare(tmp_path / "charts")
    table = write(tmp_path / "charts", "fit", results)
    assert read_results(tmp_path / "charts/fit.csv", FitTrial) == results
    assert image_size(tmp_path / "charts/fit.png")[0] > 800
    assert (tmp_path / "charts/fit.md").read_text() == table
    assert "| paper |" in table
    (tmp_path / "charts/fit.md").unlink()
    assert redraw(tmp_path) == [tmp_path / "charts/fit.csv"]
    assert (tmp_path / "charts/fit.md").read_text() == table
    instant_trials = tuple(replace(trial, seconds=1e-3, rotation=0.0) for trial in results.rows)
    write(tmp_path, "fit", replace(results, rows=instant_trials))
    assert (tmp_path / "fit.png").exists()
