import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from core.benchmarks import model_sizes as sizes
from core.benchmarks.charts import prepare, sizes_table, write_sizes
from core.benchmarks.model_sizes import Measured, measured
from core.datasets.srn import Dataset, find_objects, write_manifest, write_object
from core.evaluation.protocol import Protocol
from core.fitting.fit import PRESETS, FitSettings
from core.models.field import FieldConfig
from core.models.model import Model
from core.training.trainer import RECIPES, TrainSettings, TrainStep
from tests.core.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model


def test_every_model_of_the_plan_differs_in_one_number() -> None:
    centre, *others, ours = sizes.plan()
    assert (centre[2], ours[2]) == (sizes.CENTRE, RECIPES["ours"].field)
    assert len({config for _, _, config in others}) == len(others)
    for axis, value, config in others:
        assert config == replace(sizes.CENTRE, **{axis: value})
        assert config != sizes.CENTRE


class Taught:
    """A trainer that needs no steps. It notes the sizes that it was asked for."""

    asked: ClassVar[list[FieldConfig]]

    def __init__(self, dataset: Dataset, recipe: TrainSettings) -> None:
        Taught.asked.append(recipe.field)

    def steps(self) -> Iterator[TrainStep]:
        return iter(())

    def model(self) -> Model:
        return tiny_model()


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measured:
    for preset in ("draft", "normal"):
        monkeypatch.setitem(PRESETS, preset, FitSettings(hypotheses=2, steps=5, rays=32, samples=8))
    monkeypatch.setattr(sizes, "Trainer", Taught)
    monkeypatch.setattr(sizes, "Protocol", lambda every: Protocol(inputs=(0,)))
    for index in range(4):
        write_object(tmp_path / "data", replace(views_of(tiny_model(), index, 3), name=f"stool{index}"))
    write_manifest(tmp_path / "data", "stools", {f"stool{i}": (f"s{i}", f"t{i}") for i in range(4)})
    folders, places = [tmp_path / "data"], find_objects([tmp_path / "data"])[1]
    (tmp_path / "models").mkdir()
    monkeypatch.setattr(Taught, "asked", [], raising=False)
    two = [("centre", 0, tiny_model().field.config), ("width", 32, tiny_model().field.config)]
    monkeypatch.setattr(sizes, "plan", lambda: two)
    *_, found = measured(folders, places[:1], 20, tmp_path / "models")
    for done in ("Trainer", "evaluate", "read_dataset"):  # from now on all comes from what is kept
        monkeypatch.setattr(sizes, done, None)
    *_, again = measured(folders, places[:1], 20, tmp_path / "models")
    with pytest.raises(TypeError):  # other tests are measured anew
        list(measured(folders, places[1:2], 20, tmp_path / "models"))
    assert again.sizes[0].own == found.sizes[0].own
    assert Taught.asked == [size for _, _, size in two]
    monkeypatch.setattr(sizes, "plan", lambda: [("centre", 0, sizes.CENTRE)])
    with pytest.raises(TypeError):  # so is a model of another size
        list(measured(folders, places[:1], 20, tmp_path / "models"))
    return found


def test_models_are_trained_once_and_measured(found: Measured, tmp_path: Path) -> None:
    assert [(one.axis, one.value) for one in found.sizes] == [("centre", 0), ("width", 32)]
    assert all(one.own > 0 and one.bytes > 0 and one.field_ms > 0 and one.fit_seconds > 0 for one in found.sizes)
    assert [one.gain.mean for one in found.sizes] == [0, 0]  # the same model twice
    assert len({one.found.mean for one in found.sizes}) == 1
    prepare(tmp_path / "charts")
    write_sizes(found, tmp_path / "charts")
    assert json.loads((tmp_path / "charts/size.json").read_text())["steps"] == 20
    assert (tmp_path / "charts/size.md").read_text() == sizes_table(found)
    assert (tmp_path / "charts/size.png").stat().st_size > 5000
