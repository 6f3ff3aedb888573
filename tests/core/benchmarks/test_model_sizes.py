from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from core.benchmarks import model_sizes
from core.benchmarks.charts import read_model_sizes, write_model_sizes
from core.benchmarks.drawing import prepare
from core.benchmarks.model_sizes import ModelSizeResults, run
from core.benchmarks.tables import model_sizes_table
from core.datasets.srn import Dataset, index_objects, write_manifest, write_object
from core.evaluation.protocol import Protocol
from core.fitting.fit import PRESETS, FitSettings
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.training.recipes import RECIPES, TrainSettings
from core.training.trainer import TrainStep
from tests.core.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model


def test_every_model_of_the_sweep_differs_in_one_number() -> None:
    baseline, *others, default = model_sizes.sweep()
    assert (baseline[2], default[2]) == (model_sizes.BASELINE, RECIPES["default"].field)
    assert len({config for _, _, config in others}) == len(others)
    for axis, value, config in others:
        assert config == replace(model_sizes.BASELINE, **{axis: value})
        assert config != model_sizes.BASELINE


class FakeTrainer:
    """A trainer that needs no steps. It notes the sizes that it was given."""

    given: ClassVar[list[FieldConfig]]

    def __init__(self, dataset: Dataset, recipe: TrainSettings) -> None:
        FakeTrainer.given.append(recipe.field)

    def steps(self) -> Iterator[TrainStep]:
        return iter(())

    def model(self) -> Model:
        return tiny_model()


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModelSizeResults:
    for preset in ("draft", "normal"):
        monkeypatch.setitem(PRESETS, preset, FitSettings(hypotheses=2, steps=5, rays=32, samples=8))
    monkeypatch.setattr(model_sizes, "Trainer", FakeTrainer)
    monkeypatch.setattr(model_sizes, "Protocol", lambda every: Protocol(inputs=(0,)))
    for index in range(4):
        write_object(tmp_path / "data", replace(views_of(tiny_model(), index, 3), name=f"stool{index}"))
    write_manifest(tmp_path / "data", "stools", {f"stool{i}": (f"s{i}", f"t{i}") for i in range(4)})
    folders, places = [tmp_path / "data"], index_objects([tmp_path / "data"])[1]
    (tmp_path / "models").mkdir()
    monkeypatch.setattr(FakeTrainer, "given", [], raising=False)
    two = [("baseline", 0, tiny_model().field.config), ("width", 32, tiny_model().field.config)]
    monkeypatch.setattr(model_sizes, "sweep", lambda: two)
    *_, found = run(folders, places[:1], 20, tmp_path / "models")
    for done in ("Trainer", "evaluate", "read_dataset"):  # from now on all comes from what is kept
        monkeypatch.setattr(model_sizes, done, None)
    *_, again = run(folders, places[:1], 20, tmp_path / "models")
    with pytest.raises(TypeError):  # other tests are measured anew
        list(run(folders, places[1:2], 20, tmp_path / "models"))
    assert again.sizes[0].new_views == found.sizes[0].new_views
    assert FakeTrainer.given == [size for _, _, size in two]
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
