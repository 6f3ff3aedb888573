import json
import math
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch

from core.fitting.fit import PRESETS, FitJob, FitSettings
from core.lab.datasets.srn import ObjectViews
from core.lab.evaluation import protocol as module
from core.lab.evaluation.protocol import (
    EvaluationProtocol,
    ObjectScore,
    PoseScore,
    evaluate,
    format_table,
    mean_of,
    summarise,
    write_report,
)
from core.metrics import psnr, rotation_error, ssim, translation_error
from core.models.model import Model
from core.rendering.reference import render_exact


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = FitSettings(hypotheses=8, steps=40, rays=96, samples=20)
    monkeypatch.setitem(PRESETS, "normal", settings)


def views_of(model: Model, index: int, count: int = 4) -> ObjectViews:
    """Return renders of a training object from all sides."""
    cameras = tuple(model.camera(0.7 + 1.3 * turn, 0.4) for turn in range(count))
    renders = [render_exact(model[index], camera, 64) for camera in cameras]
    images = np.stack([(render.colour.clamp(0, 1) * 255 + 0.5).byte().numpy() for render in renders])
    masks = np.stack([(render.opacity > 0.5).numpy() for render in renders])
    return ObjectViews(f"stool{index}", "s", "t", images, masks, cameras)


def test_scores_are_those_of_renders_by_hand_on_all_or_every_other_view(tiny: Model):
    views = views_of(tiny, 1)
    (score,) = evaluate(tiny, [views], EvaluationProtocol(inputs=(2,)))
    _, last = module.fit_first_last(tiny, FitJob((module.as_photo(views, 2, True),), PRESETS["normal"]))
    by_hand = []
    for index in (0, 1, 3):
        drawn = render_exact(last.instance, views.cameras[index], 192).colour.clamp(0, 1)
        truth = torch.from_numpy(views.images[index]).float() / 255
        by_hand.append((psnr(drawn, truth), ssim(drawn, truth)))
    expected = np.mean(by_hand, 0)
    # Beyond 45 dB the fast renderer's own error counts.
    assert min(score.psnr, 45) == pytest.approx(min(expected[0], 45), abs=2.0)
    assert score.ssim == pytest.approx(expected[1], abs=0.01)
    assert score.psnr > 22
    assert (score.name, score.views, score.poses) == ("stool1", 3, ())
    assert score.seconds > 0
    (half,) = evaluate(tiny, [views], EvaluationProtocol(inputs=(2,), every=2))
    assert half.views == 2  # of 0, 1, 3: 0 and 3
    assert half.psnr == pytest.approx(score.psnr, abs=1.0)


def test_estimated_cameras_are_compared_with_the_true_ones(tiny: Model):
    views = views_of(tiny, 1)
    (score,) = evaluate(tiny, [views], EvaluationProtocol(inputs=(1,), estimate=True))
    job = FitJob((module.as_photo(views, 1, False),), PRESETS["normal"])
    first, last = module.fit_first_last(tiny, job)
    (pose,) = score.poses
    assert pose.rotation == pytest.approx(rotation_error(last.cameras[0], views.cameras[1]))
    assert pose.translation == pytest.approx(translation_error(last.cameras[0], views.cameras[1]))
    assert pose.initial_rotation == pytest.approx(rotation_error(first.cameras[0], views.cameras[1]))
    assert pose.view == 1
    assert pose.rotation < 15


def test_objects_are_scored_one_by_one_and_read_lazily(tiny: Model):
    objects = (views_of(tiny, index, 2) for index in range(4))
    scores = list(islice(evaluate(tiny, objects, EvaluationProtocol(inputs=(0,))), 2))
    assert [score.name for score in scores] == ["stool0", "stool1"]
    assert next(objects).name == "stool2"


def test_too_few_views_and_other_focal_lengths_are_refused(tiny: Model):
    views = views_of(tiny, 0, 2)
    for inputs in ((2,), (0, 1)):
        with pytest.raises(ValueError, match="stool0: 2 views"):
            list(evaluate(tiny, [views], EvaluationProtocol(inputs=inputs)))
    closer = replace(views, cameras=tuple(replace(camera, focal=90.0) for camera in views.cameras))
    with pytest.raises(ValueError, match="focal length"):
        list(evaluate(tiny, [closer], EvaluationProtocol(inputs=(0,), estimate=True)))
    for inputs in ((), (-1,), (3, 3)):
        with pytest.raises(ValueError, match="input views"):
            EvaluationProtocol(inputs=inputs)


# Averages


def test_the_bootstrap_interval_matches_the_normal_one():
    values = np.random.default_rng(1).normal(25, 2, 400)
    mean = mean_of(values.tolist())
    half = 1.96 * values.std(ddof=1) / math.sqrt(len(values))
    assert mean.mean == pytest.approx(values.mean())
    assert mean.low == pytest.approx(values.mean() - half, abs=0.05)
    assert mean.high == pytest.approx(values.mean() + half, abs=0.05)
    assert mean == mean_of(values.tolist())
    assert math.isnan(mean_of([]).mean)


def score(name: str, value: float, *rotations: float, translation: float = 0.01) -> ObjectScore:
    poses = tuple(PoseScore(64, rotation, translation, 80.0, 1.0) for rotation in rotations)
    return ObjectScore(name, value, value / 30, 3, 2.0, poses)


def test_outliers_are_left_out_and_objects_weigh_alike():
    scores = [score("good", 24, 2.0), score("turned", 12, 170.0), score("away", 20, 1.0, translation=0.2)]
    summary = summarise(scores)
    assert summary.pose is not None
    assert (summary.objects, summary.without_outliers.objects) == (3, 1)
    assert summary.psnr.mean == pytest.approx(56 / 3)
    assert summary.without_outliers.psnr.mean == 24
    assert summary.pose.within_5_degrees.mean == pytest.approx(2 / 3)
    assert summary.pose.within_3_percent.mean == pytest.approx(2 / 3)
    assert summary.pose.initial_rotation.mean == 80
    summary = summarise([score("a", 20, 0.0, 0.0, 9.0), score("b", 20, 9.0)])
    assert summary.pose.cameras == 4
    assert summary.pose.rotation.mean == pytest.approx(6)
    assert summary.pose.within_5_degrees.mean == pytest.approx((2 / 3 + 0) / 2)


# Reports

ESTIMATED = [
    ObjectScore("a", 24.0, 0.9, 250, 4.0, (PoseScore(64, 2.0, 0.01, 80.0, 1.1),)),
    ObjectScore("b", 12.0, 0.7, 250, 6.0, (PoseScore(64, 179.0, 1.99, 90.0, 1.2),)),
]
KNOWN = [ObjectScore("a", 24.0, 0.9, 250, 4.0), ObjectScore("b", 26.0, 0.92, 250, 6.0)]


def test_known_cameras_give_a_row_of_the_papers_table():
    text = format_table(KNOWN, EvaluationProtocol())
    assert "1-view (64), camera known" in text
    assert "25.00 [24.00, 26.00]" in text
    assert "0.910 [0.900, 0.920]" in text
    assert "rotation" not in text
    assert "5.0 s for a fit" in text


def test_estimated_cameras_add_errors_and_outliers_or_a_dash():
    text = format_table(ESTIMATED, EvaluationProtocol((64, 104), estimate=True))
    lines = {line.split("  ")[0].strip(): line for line in text.splitlines()}
    assert "2-view (64, 104), camera estimated" in text
    assert "24.00 [24.00, 24.00]" in next(line for line in text.splitlines() if "- outliers (over" in line)
    assert "90.50" in lines["rotation (degrees)"]
    assert "85.00" in lines["rotation (degrees)"]
    assert "50 [0, 100]" in lines["within 5 degrees (%)"]
    assert " - " in format_table(ESTIMATED[1:], EvaluationProtocol(estimate=True))


def test_the_report_holds_every_object_and_no_nan(tmp_path: Path):
    write_report(tmp_path / "r.json", ESTIMATED[1:], EvaluationProtocol(estimate=True), {"model": "m"})
    text = (tmp_path / "r.json").read_text()
    report = json.loads(text)
    assert "NaN" not in text
    assert report["summary"]["without_outliers"]["psnr"] == [None, None, None]
    assert report["objects"][0]["poses"][0]["rotation"] == 179.0
    assert report["objects"][0]["outlier"]
    assert report["protocol"] == {"inputs": [64], "estimate": True, "preset": "normal", "seed": 0, "every": 1}
