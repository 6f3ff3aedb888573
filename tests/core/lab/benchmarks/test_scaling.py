import itertools
from pathlib import Path

import pytest

from core.lab.benchmarks import scaling
from core.lab.benchmarks.scaling import measure_scaling, subsets
from core.lab.datasets.srn import ObjectEntry
from tests.core.lab.benchmarks.test_trained_models import train_nothing


def test_each_set_of_shapes_holds_the_smaller_ones_in_all_textures() -> None:
    entries = [
        ObjectEntry(Path(f"{shape}-{texture}"), f"s{shape}", f"t{texture}") for shape in range(20) for texture in "ab"
    ]
    found = subsets(entries)
    assert [len({one.shape_id for one in some}) for some in found] == [3, 5, 10, 20]
    assert all(set(few) <= set(more) for few, more in itertools.pairwise(found))
    assert all(len(some) == 2 * len({one.shape_id for one in some}) for some in found) and found[-1] == tuple(entries)


def test_models_are_trained_on_more_and_more_shapes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, entries, given = train_nothing(tmp_path, monkeypatch)
    monkeypatch.setattr(scaling, "STRIDES", (2, 1))
    *said, found = measure_scaling(folders, entries[:1], 20, tmp_path / "models")
    assert [(one.shapes, one.objects) for one in found.rows] == [(2, 2), (4, 4)]
    assert [len(dataset.objects) for dataset, _ in given] == [2, 4]
    assert {settings.steps for _, settings in given} == {int(found.about["steps"])} == {20}
    few, many = found.rows
    assert few.gain.mean == 0
    assert many.gain.mean == pytest.approx(many.held_out.mean - few.held_out.mean) and many.gain.mean > 1
    assert said
