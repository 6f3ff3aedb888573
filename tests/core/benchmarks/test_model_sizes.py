from dataclasses import replace
from pathlib import Path

import pytest

from core.benchmarks import model_sizes, trained_models
from core.benchmarks.drawing import prepare
from core.benchmarks.model_sizes import ModelSizeResults, run
from core.benchmarks.tables import model_sizes_table
from core.benchmarks.training_charts import read_model_sizes, write_model_sizes
from core.training.recipes import RECIPES
from tests.core.benchmarks.test_trained_models import train_nothing
from tests.core.tiny import tiny_model


def test_every_model_of_the_sweep_differs_in_one_number() -> None:
    baseline, *others, default = model_sizes.sweep()
    assert (baseline[2], default[2]) == (model_sizes.BASELINE, RECIPES["default"].field)
    assert len({config for _, _, config in others}) == len(others)
    for axis, value, config in others:
        assert config == replace(model_sizes.BASELINE, **{axis: value})
        assert config != model_sizes.BASELINE


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModelSizeResults:
    folders, places, given = train_nothing(tmp_path, monkeypatch)
    two = [("baseline", 0, tiny_model().field.config), ("width", 32, tiny_model().field.config)]
    monkeypatch.setattr(model_sizes, "sweep", lambda: two)
    *_, found = run(folders, places[:1], 20, tmp_path / "models")
    for done in ("Trainer", "evaluate", "read_dataset"):  # from now on all comes from what is kept
        monkeypatch.setattr(model_sizes if done == "read_dataset" else trained_models, done, None)
    *_, again = run(folders, places[:1], 20, tmp_path / "models")
    with pytest.raises(TypeError):  # other tests are measured anew
        list(run(folders, places[1:2], 20, tmp_path / "models"))
    assert again.sizes[0].new_views == found.sizes[0].new_views
    assert [settings.field for _, settings in given] == [size for _, _, size in two]
    monkeypatch.setattr(model_sizes, "sweep", lambda: [("baseline", 0, model_sizes.BASELINE)])
    with pytest.raises(TypeError):  # so is a model of another size
        list(run(folders, places[:1], 20, tmp_path / "models"))
    return found


def test_models_are_trained_once_and_measured(found: ModelSizeResults, tmp_path: Path) -> None:
    assert [(one.axis, one.value) for one in found.sizes] == [("baseline", 0), ("width", 32)]
    assert all(one.new_views > 0 and one.bytes > 0 and one.field_ms > 0 and one.fit_seconds > 0 for one in found.sizes)
    assert [one.gain.mean for one in found.sizes] == [0, 0]  # the same model twice
    assert len({one.found.mean for one in found.sizes}) == 1
    prepare(tmp_path / "charts")
    write_model_sizes(found, tmp_path / "charts")
    assert read_model_sizes(tmp_path / "charts/model_sizes.csv") == found
    assert (tmp_path / "charts/model_sizes.md").read_text() == model_sizes_table(found)
    assert (tmp_path / "charts/model_sizes.png").stat().st_size > 5000
