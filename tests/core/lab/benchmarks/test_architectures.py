from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.geometry.camera import Camera
from core.lab.benchmarks import architectures, trained_models
from core.lab.benchmarks.architectures import ARCHITECTURES, ArchitectureResults, measure_architectures
from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.drawing import prepare
from core.lab.training.recipes import RECIPES
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import Rendered, render_exact
from tests.core.lab.benchmarks.test_trained_models import train_nothing


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ArchitectureResults:
    folders, _, given = train_nothing(tmp_path, monkeypatch)
    *said, _ = measure_architectures(folders, 20, tmp_path / "models")
    assert [settings for _, settings in given] == [replace(RECIPES[one], steps=20) for one in ARCHITECTURES.values()]
    assert said
    monkeypatch.setattr(trained_models, "Trainer", None)  # from now on the models come from where they are kept
    *_, again = measure_architectures(folders, 20, tmp_path / "models")
    assert isinstance(again, ArchitectureResults)
    return again


def test_every_architecture_is_scored_and_shown(found: ArchitectureResults) -> None:
    assert [one.name for one in found.rows] == list(ARCHITECTURES)
    assert (found.about["objects"], found.about["steps"]) == ("4", "20")
    for one in found.rows:  # the tiny model stands for all of them, and is a CodeNeRF
        assert one.opacity_change == (0, 0, 0)
        assert one.new_views > 0 and one.parameters > 0
    width, height = found.picture.size
    assert width % 6 == 0 and height % (2 * len(ARCHITECTURES)) == 0


def test_what_another_texture_does_to_the_opacity_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, *_ = train_nothing(tmp_path, monkeypatch)
    shown: list[float] = []

    def render(model: Model, codes: Codes, camera: Camera, samples: int) -> Rendered:
        found = render_exact(model, codes, camera, samples)
        shown.append(0.6 + 0.1 * (len(shown) % 2))
        return replace(found, opacity=torch.full_like(found.opacity, shown[-1]))

    monkeypatch.setattr(architectures, "render_exact", render)
    *_, found = measure_architectures(folders, 20, tmp_path / "models")
    assert isinstance(found, ArchitectureResults)
    for one in found.rows:
        assert one.opacity_change.mean == pytest.approx(0.1)


def test_a_model_that_shows_nothing_yet_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, *_ = train_nothing(tmp_path, monkeypatch)

    def render(model: Model, codes: Codes, camera: Camera, samples: int) -> Rendered:
        found = render_exact(model, codes, camera, samples)
        return replace(found, opacity=torch.zeros_like(found.opacity))

    monkeypatch.setattr(architectures, "render_exact", render)
    with pytest.raises(ValueError, match="train it for more steps"):
        list(measure_architectures(folders, 20, tmp_path / "models"))


def test_they_are_written_and_drawn_again(found: ArchitectureResults, tmp_path: Path) -> None:
    prepare(tmp_path / "charts")
    table = write(tmp_path / "charts", "architectures", found)
    assert table.count("\n| ") == 1 + len(ARCHITECTURES) and "| CodeNeRF |" in table
    (tmp_path / "charts/architectures.md").unlink()
    assert redraw(tmp_path / "charts") == [tmp_path / "charts/architectures.csv"]
    assert (tmp_path / "charts/architectures.md").read_text() == table
