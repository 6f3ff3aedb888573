from pathlib import Path

import pytest
from PIL import Image

from core.benchmarks import trained_models
from core.benchmarks.architectures import ARCHITECTURES, ArchitectureResults, run
from core.benchmarks.charts import redraw
from core.benchmarks.drawing import prepare
from core.benchmarks.training_charts import write_architectures
from core.training.recipes import RECIPES
from tests.core.benchmarks.test_trained_models import train_nothing


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ArchitectureResults:
    folders, _, given = train_nothing(tmp_path, monkeypatch)
    *said, _ = run(folders, 20, tmp_path / "models")
    assert [settings.field for _, settings in given] == [RECIPES[name].field for name in ARCHITECTURES.values()]
    assert said
    monkeypatch.setattr(trained_models, "Trainer", None)  # from now on the models come from where they are kept
    *_, again = run(folders, 20, tmp_path / "models")
    assert isinstance(again, ArchitectureResults)
    return again


def test_every_architecture_is_scored_and_shown(found: ArchitectureResults) -> None:
    assert [one.name for one in found.architectures] == list(ARCHITECTURES)
    assert found.objects == 4 and found.steps == 20
    for one in found.architectures:  # the tiny model stands for all of them, and is a CodeNeRF
        assert one.opacity_change == (0, 0, 0)
        assert one.new_views > 0 and one.parameters > 0
    width, height = found.picture.size
    assert width % 6 == 0 and height % (2 * len(ARCHITECTURES)) == 0


def test_they_are_written_with_their_picture(found: ArchitectureResults, tmp_path: Path) -> None:
    prepare(tmp_path / "charts")
    write_architectures(found, tmp_path / "charts")
    with Image.open(tmp_path / "charts/architectures.png") as picture:
        assert picture.size == found.picture.size
    table = (tmp_path / "charts/architectures.md").read_text()
    assert table.count("\n| ") == 1 + len(ARCHITECTURES) and "| CodeNeRF |" in table
    (tmp_path / "charts/architectures.md").unlink()
    assert redraw(tmp_path / "charts") == [tmp_path / "charts/architectures.csv"]
    assert (tmp_path / "charts/architectures.md").read_text() == table
