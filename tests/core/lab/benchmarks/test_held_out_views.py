import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.geometry.camera import Camera
from core.lab.benchmarks import held_out_views
from core.lab.benchmarks.held_out_views import BENCHMARK, DATASETS, HeldOutView, held_out_view, is_symmetric_view
from core.lab.datasets.srn import read_dataset
from core.models.model import Instance
from tests.conftest import random_model
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model

ASSETS = BENCHMARK.parent
LARGEST = 3_000_000  # bytes of the benchmark


def test_the_benchmark_has_credited_objects_that_no_model_was_trained_on():
    lists = json.loads((ASSETS / "held_out.json").read_text())
    credits_page = (ASSETS / "CREDITS.md").read_text()
    for path in DATASETS:
        dataset = read_dataset(path)
        held_out = {name for split in ("validation", "test") for name in lists[split][dataset.category]}
        names = [views.name for views in dataset.objects]
        assert len(names) == 6 and dataset.image_size == 128
        assert set(names) <= held_out
        for views in dataset.objects:
            assert len(views.cameras) == 16 and views.masks.any((1, 2)).all()
            assert (views.images[~views.masks].mean() > 250) and f"| {views.name} |" in credits_page
            row = next(line for line in credits_page.splitlines() if line.startswith(f"| {views.name} |"))
            assert "CC0 1.0" in row
    assert sum(path.stat().st_size for path in Path(BENCHMARK).iterdir()) < LARGEST


def test_photos_and_scored_views_differ_and_stay_the_same():
    view = held_out_view(DATASETS, "cars", "kenney_suv", 0)
    assert sorted(view.order) == list(range(16))
    assert HeldOutView(view.model, view.views, 1).order != view.order == HeldOutView(view.model, view.views).order
    photos = view.photos(3, posed=True)
    assert [photo.camera for photo in photos] == list(view.cameras(3))
    assert view.photos(1, posed=False)[0].camera is None
    assert view.partner.name == "kenney_van" and view.stranger.name == "polyhaven_dining_chair_02"


def test_datasets_of_one_category_are_joined():
    folders = DATASETS[0], DATASETS[0]
    assert held_out_view(folders, "chairs", "polyhaven_armchair_01", 0).stranger is None


def test_an_object_of_too_few_views_is_refused():
    with pytest.raises(ValueError, match="stool0: a benchmark needs 10 views"):
        HeldOutView(tiny_model(), views_of(tiny_model(), 0, 4))


def test_networks_that_render_their_background_have_masks():
    model = random_model(1, True)
    image, mask = held_out_views.render_on_white(model.mean, model.camera(0.3, 0.3))
    assert image.shape[-1] == 3 and mask.dtype == torch.bool


def test_views_from_which_the_object_looks_the_same_are_symmetric(monkeypatch: pytest.MonkeyPatch):
    lopsided = tiny_model()[0]
    truth = lopsided.model.camera(0.7, 0.4)
    assert is_symmetric_view(lopsided, replace(truth, azimuth=0.75), truth)
    assert not is_symmetric_view(lopsided, replace(truth, azimuth=0.7 + math.pi), truth)
    plain = held_out_views.render_on_white

    def symmetric(instance: Instance, camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
        return plain(instance, replace(camera, azimuth=camera.azimuth % math.pi))

    monkeypatch.setattr(held_out_views, "render_on_white", symmetric)
    assert is_symmetric_view(lopsided, replace(truth, azimuth=0.71 + math.pi), truth)
    assert not is_symmetric_view(lopsided, replace(truth, azimuth=0.7 + math.pi / 2), truth)
