from dataclasses import replace
from pathlib import Path

import pytest

from core.lab.benchmarks import model_sizes, trained_models
from core.lab.benchmarks.charts import write
from core.lab.benchmarks.csv_files import Results, read_results
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


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Results[ModelSize]:
    folders, places, given = train_nothing(tmp_path, monkeypatch)
    two = [("baseline", 0, tiny_model().field.config), ("width", 32, tiny_model().field.config)]
    monkeypatch.setattr(model_sizes, "sweep", lambda: two)
    *_, found = measure_model_sizes(folders, places[:1], 20, tmp_path / "models")
    for done in ("Trainer", "evaluate", "read_dataset"):  # from now on all comes from what is kept
        monkeypatch.setattr(trained_models, done, None)
    *_, again = measure_model_sizes(folders, places[:1], 20, tmp_path / "models")
    with pytest.raises(TypeError):  # other tests are measured anew
        list(measure_model_sizes(folders, places[1:2], 20, tmp_path / "models"))
    assert again.rows[0].new_views == found.rows[0].new_views
    assert [settings.field for _, settings in given] == [size for _, _, size in two]
    monkeypatch.setattr(model_sizes, "sweep", lambda: [("baseline", 0, model_sizes.BASELINE)])
    with pytest.raises(TypeError):  # so is a model of another size
        list(measure_model_sizes(folders, places[:1], 20, tmp_path / "models"))
    return found


def test_models_are_trained_once_and_measured(found: Results[ModelSize], tmp_path: Path) -> None:
    assert [(one.axis, one.value) for one in found.rows] == [("baseline", 0), ("width", 32)]
    assert all(one.new_views > 0 and one.bytes > 0 and one.field_ms > 0 and one.fit_seconds > 0 for one in found.rows)
    assert [one.gain.mean for one in found.rows] == [0, 0]  # the same model twice
    assert len({one.found.mean for one in found.rows}) == 1
    prepare(tmp_path / "charts")
    table = write(tmp_path / "charts", "model_sizes", found)
    assert read_results(tmp_path / "charts/model_sizes.csv", ModelSize) == found
    assert (tmp_path / "charts/model_sizes.md").read_text() == table and "| width 32 |" in table
    assert (tmp_path / "charts/model_sizes.png").stat().st_size > 5000
