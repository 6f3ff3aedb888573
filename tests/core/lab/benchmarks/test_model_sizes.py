from dataclasses import replace
from pathlib import Path

import pytest

from core.lab.benchmarks import model_sizes
from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.csv_files import read_results
from core.lab.benchmarks.drawing import prepare
from core.lab.benchmarks.model_sizes import ModelSize, measure_model_sizes
from core.lab.training.recipes import RECIPES
from tests.core.lab.benchmarks.test_trained_models import train_nothing
from tests.core.tiny import tiny_model


def test_every_model_of_the_sweep_differs_in_one_number() -> None:
    baseline, *others, default = model_sizes.sweep()
    assert (baseline[2], default[2]) == (model_sizes.BASELINE, RECIPES["default"].field)
    assert len({config for _, _, config in others}) == len(others)
    for axis, value, config in others:
        assert config == replace(model_sizes.BASELINE, **{axis: value})
        assert config != model_sizes.BASELINE


def test_every_size_is_trained_measured_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, places, given = train_nothing(tmp_path, monkeypatch)
    two = [("baseline", 0, tiny_model().field.config), ("width", 32, tiny_model().field.config)]
    monkeypatch.setattr(model_sizes, "sweep", lambda: two)
    *_, found = measure_model_sizes(folders, places[:1], 20, tmp_path / "models")
    assert [settings.field for _, settings in given] == [size for _, _, size in two]
    assert [(one.axis, one.value) for one in found.rows] == [("baseline", 0), ("width", 32)]
    assert all(one.new_views > 0 and one.bytes > 0 and one.field_ms > 0 and one.fit_seconds > 0 for one in found.rows)
    assert [one.gain.mean for one in found.rows] == [0, 0]  # the same model twice
    assert len({one.found.mean for one in found.rows}) == 1
    prepare(tmp_path / "charts")
    table = write(tmp_path / "charts", "model_sizes", found)
    assert read_results(tmp_path / "charts/model_sizes.csv", ModelSize) == found
    assert (tmp_path / "charts/model_sizes.md").read_text() == table and "| width 32 |" in table
    (tmp_path / "charts/model_sizes.png").unlink()
    assert redraw(tmp_path / "charts") == [tmp_path / "charts/model_sizes.csv"]
    assert (tmp_path / "charts/model_sizes.png").stat().st_size > 5000
