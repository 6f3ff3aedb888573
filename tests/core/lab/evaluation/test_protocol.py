from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch

from core.fitting.fit import PRESETS, FitJob, FitSettings
from core.lab.datasets.srn import ObjectViews
from core.lab.evaluation import protocol as module
from core.lab.evaluation.protocol import EvaluationProtocol, ObjectScore, PoseScore, evaluate, summarise
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


def test_two_inputs_beat_images_of_the_wrong_view(tiny: Model):
    views = views_of(tiny, 2)
    (score,) = evaluate(tiny, [views], EvaluationProtocol(inputs=(0, 2)))
    assert score.views == 2
    wrong = replace(views_of(tiny, 0), images=views_of(tiny, 0).images[[0, 0, 0, 0]])
    (worse,) = evaluate(tiny, [wrong], EvaluationProtocol(inputs=(0, 2)))
    assert score.psnr > worse.psnr + 3


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
    read = []

    def lazily():
        for index in range(4):
            read.append(index)
            yield views_of(tiny, index, 2)

    scores = list(islice(evaluate(tiny, lazily(), EvaluationProtocol(inputs=(0,))), 2))
    assert [score.name for score in scores] == ["stool0", "stool1"]
    assert read == [0, 1]


def test_too_few_views_and_other_focal_lengths_are_refused(tiny: Model):
    views = views_of(tiny, 0, 2)
    with pytest.raises(ValueError, match="stool0: 2 views"):
        list(evaluate(tiny, [views], EvaluationProtocol(inputs=(2,))))
    with pytest.raises(ValueError, match="stool0: 2 views"):
        list(evaluate(tiny, [views], EvaluationProtocol(inputs=(0, 1))))
    closer = replace(views, cameras=tuple(replace(camera, focal=90.0) for camera in views.cameras))
    with pytest.raises(ValueError, match="focal length"):
        list(evaluate(tiny, [closer], EvaluationProtocol(inputs=(0,), estimate=True)))
    for inputs in ((), (-1,), (3, 3)):
        with pytest.raises(ValueError, match="input views"):
            EvaluationProtocol(inputs=inputs)


# Averages


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
