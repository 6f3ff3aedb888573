import math
from dataclasses import replace

import pytest
import torch

from core.geometry.camera import Camera
from core.lab.benchmarks import held_out_views
from core.lab.benchmarks.held_out_views import HELD_OUT_VIEWS, is_symmetric_view, random_camera, training_object_views
from core.metrics import psnr
from core.models.model import Instance
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.tiny import tiny_model


def test_training_objects_are_rendered_from_the_upper_hemisphere():
    model = tiny_model()
    targets = tuple(training_object_views(model, 2, torch.Generator().manual_seed(1)))
    assert [target.views.name for target in targets] == ["stool0", "stool2"]
    for target, instance in zip(targets, (model[0], model[2]), strict=True):
        assert len(target.views.cameras) == 1 + HELD_OUT_VIEWS
        exact = render_exact(instance, target.camera, 96).colour.clamp(0, 1)
        assert psnr(torch.from_numpy(target.views.images[target.index]) / 255, exact) > 35
        assert 0.01 < target.views.masks[target.index].mean() < 0.9
    generator = torch.Generator().manual_seed(0)
    heights = [math.sin(random_camera(model, generator).elevation) for _ in range(300)]
    assert min(heights) >= 0
    assert sum(heights) / len(heights) == pytest.approx(0.5, abs=0.05)


def test_networks_that_render_their_background_have_views():
    target, *_ = training_object_views(random_model(1, True), 1, torch.Generator().manual_seed(0))
    assert target.views.images.shape[-1] == 3


def test_views_from_which_the_object_looks_the_same_are_symmetric(monkeypatch: pytest.MonkeyPatch):
    lopsided = tiny_model()[0]
    truth = lopsided.model.camera(0.7, 0.4)
    assert is_symmetric_view(lopsided, replace(truth, azimuth=0.75), truth, 5.0)
    assert not is_symmetric_view(lopsided, replace(truth, azimuth=0.7 + math.pi), truth, 5.0)
    plain = held_out_views.render_on_white

    def symmetric(instance: Instance, camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
        return plain(instance, replace(camera, azimuth=camera.azimuth % math.pi))

    monkeypatch.setattr(held_out_views, "render_on_white", symmetric)
    assert is_symmetric_view(lopsided, replace(truth, azimuth=0.71 + math.pi), truth, 5.0)
    assert not is_symmetric_view(lopsided, replace(truth, azimuth=0.7 + math.pi / 2), truth, 5.0)
