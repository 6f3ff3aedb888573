from pathlib import Path

import pytest

from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks.held_out_views import DATASETS
from core.lab.benchmarks.pictures import EXCHANGE, FAILURE, PHOTOS, draw_exchange, draw_failure, draw_photos
from core.lab.benchmarks.results import frame_of
from core.lab.benchmarks.stability import StabilityTrial
from tests.conftest import image_size

HASTY = FitSettings(hypotheses=2, steps=4, rays=64, samples=24, free_steps=1, max_restarts=0)


def trial(name: str, right: bool, confidence: float) -> StabilityTrial:
    case = "truncation 0.3, normal"
    fitted = {"rotation": 90.0, "right": right, "confidence": confidence}
    return StabilityTrial("cars", name, 0, case, "truncation", 0.3, "normal", **fitted)


def test_the_surest_wrong_fit_and_every_exchange_and_number_of_photos_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("draft", "normal"):
        monkeypatch.setitem(PRESETS, name, HASTY)
    draw_failure(DATASETS, frame_of([trial("kenney_suv", True, 0.9)]), tmp_path)
    assert not (tmp_path / FAILURE).exists()
    wrong = [trial("kenney_suv", False, 0.9), trial("kenney_van", False, 0.2)]
    draw_failure(DATASETS, frame_of(wrong), tmp_path)
    assert image_size(tmp_path / FAILURE) == (4 * 160, 160)
    draw_exchange(DATASETS, tmp_path)
    assert image_size(tmp_path / EXCHANGE) == (8 * 160, 4 * 160)
    draw_photos(DATASETS, tmp_path)
    assert image_size(tmp_path / PHOTOS) == (5 * 160, 2 * 160)
