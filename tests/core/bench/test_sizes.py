import json
from dataclasses import replace
from pathlib import Path

import pytest

from core.bench import sizes
from core.bench.charts import prepare, sizes_table, write_sizes
from core.bench.sizes import Measured, measured
from core.dataset import find_objects, read_dataset, write_manifest, write_object
from core.evaluate import Protocol
from core.fit import PRESETS, FitSettings
from core.train import RECIPES
from tests.core.test_evaluate import views_of
from tests.core.tiny import tiny_model


def test_every_model_of_the_plan_differs_in_one_number() -> None:
    default, *others = sizes.plan()
    assert default[2] == sizes.DEFAULT
    assert len({config for _, _, config in others}) == len(others)
    for axis, value, config in others:
        assert config == replace(sizes.DEFAULT, **{axis: value})
        assert config != sizes.DEFAULT


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measured:
    monkeypatch.setattr(sizes, "DEFAULT", replace(sizes.DEFAULT, width=16, point_octaves=3))
    monkeypatch.setitem(PRESETS, "normal", FitSettings(starts=2, steps=5, rays=32, samples=8))
    monkeypatch.setitem(RECIPES, "ours", replace(RECIPES["ours"], rays=64, samples=16, outside=32))
    monkeypatch.setattr(sizes, "Protocol", lambda: Protocol(inputs=(0,)))
    for index in range(4):
        write_object(tmp_path / "data", replace(views_of(tiny_model(), index, 3), name=f"stool{index}"))
    write_manifest(tmp_path / "data", "stools", {f"stool{i}": (f"s{i}", f"t{i}") for i in range(4)})
    dataset, places = read_dataset(tmp_path / "data"), find_objects([tmp_path / "data"])[1]
    (tmp_path / "models").mkdir()
    *_, found = measured(dataset, places[:1], 20, tmp_path / "models", slice(0, 3))
    monkeypatch.setattr(sizes, "Trainer", None)  # from now on models come from what is kept
    *_, again = measured(dataset, places[:1], 20, tmp_path / "models", slice(0, 3))
    assert [one.own for one in again.sizes] == [one.own for one in found.sizes]
    return found


def test_models_are_trained_once_and_measured(found: Measured, tmp_path: Path) -> None:
    assert [(one.axis, one.value) for one in found.sizes] == [("default", 0), ("width", 32), ("width", 64)]
    small, *_, large = found.sizes
    assert small.parameters < large.parameters
    assert small.bytes < large.bytes
    assert all(one.own > 0 and one.frame_ms > 0 and one.fit_seconds > 0 for one in found.sizes)
    prepare(tmp_path / "charts")
    write_sizes(found, tmp_path / "charts")
    assert json.loads((tmp_path / "charts/size.json").read_text())["steps"] == 20
    assert (tmp_path / "charts/size.md").read_text() == sizes_table(found)
    assert (tmp_path / "charts/size.png").stat().st_size > 5000
