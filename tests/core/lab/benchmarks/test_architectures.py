import itertools
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.geometry.camera import Camera
from core.lab.benchmarks import architectures
from core.lab.benchmarks.architectures import ARCHITECTURES, ArchitectureResults, measure_architectures
from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.drawing import prepare
from core.lab.training.recipes import RECIPES
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import Rendered, render_exact
from tests.core.lab.benchmarks.test_trained_models import train_nothing


def test_every_architecture_is_scored_shown_written_and_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders, _, given = train_nothing(tmp_path, monkeypatch)
    *said, found = measure_architectures(folders, 20, tmp_path / "models")
    assert [settings for _, settings in given] == [replace(RECIPES[one], steps=20) for one in ARCHITECTURES.values()]
    assert said
    assert isinstance(found, ArchitectureResults)
    assert [one.name for one in found.rows] == list(ARCHITECTURES)
    assert (found.about["objects"], found.about["steps"]) == ("4", "20")
    for one in found.rows:  # the tiny model stands for all of them, and is a CodeNeRF
        assert one.opacity_change == (0, 0, 0)
        assert one.new_views > 0 and one.parameters > 0
    width, height = found.picture.size
    assert width % 6 == 0 and height % (2 * len(ARCHITECTURES)) == 0
    prepare(tmp_path / "charts")
    table = write(tmp_path / "charts", "architectures", found)
    assert table.count("\n| ") == 1 + len(ARCHITECTURES) and "| CodeNeRF |" in table
    (tmp_path / "charts/architectures.md").unlink()
    assert redraw(tmp_path / "charts") == [tmp_path / "charts/architectures.csv"]
    assert (tmp_path / "charts/architectures.md").read_text() == table


def paint_opacities(monkeypatch: pytest.MonkeyPatch, *opacities: float) -> None:
    """One after the other, and again from the first."""
    turns = itertools.cycle(opacities)

    def render(model: Model, codes: Codes, camera: Camera, samples: int) -> Rendered:
        found = render_exact(model, codes, camera, 2)
        return replace(found, opacity=torch.full_like(found.opacity, next(turns)))

    monkeypatch.setattr(architectures, "render_exact", render)


def test_what_another_texture_does_to_the_opacity_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, *_ = train_nothing(tmp_path, monkeypatch)
    paint_opacities(monkeypatch, 0.6, 0.7)
    *_, found = measure_architectures(folders, 20, tmp_path / "models")
    assert isinstance(found, ArchitectureResults)
    for one in found.rows:
        assert one.opacity_change.mean == pytest.approx(0.1)


def test_a_model_that_shows_nothing_yet_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, *_ = train_nothing(tmp_path, monkeypatch)
    paint_opacities(monkeypatch, 0.0)
    with pytest.raises(ValueError, match="train it for more steps"):
        list(measure_architectures(folders, 20, tmp_path / "models"))
