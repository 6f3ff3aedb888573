import copy
import itertools
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.geometry.camera import Camera
from core.lab.benchmarks import architectures
from core.lab.benchmarks.architectures import ARCHITECTURES, ArchitectureResults, measure_architectures
from core.lab.benchmarks.charts import redraw, write
from core.lab.benchmarks.drawing import prepare
from core.lab.datasets.srn import Dataset, write_manifest, write_object
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import TrainStep
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.reference import Rendered, render_exact
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model

Given = list[TrainSettings]


@pytest.fixture
def given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Given:
    """A dataset of four objects in ``data``, and a trainer that needs no steps; what every trainer is given."""
    given: Given = []

    class FakeTrainer:
        def __init__(self, dataset: Dataset, settings: TrainSettings) -> None:
            given.append(settings)

        def steps(self) -> Iterator[TrainStep]:
            return iter(())

        def model(self) -> Model:
            field = copy.deepcopy(tiny_model().field)
            field.config = given[-1].field
            return replace(tiny_model(), field=field)

    for number, name in enumerate(ARCHITECTURES.values()):  # all of the tiny model's network, and yet to be told apart
        monkeypatch.setitem(RECIPES, name, replace(RECIPES[name], field=tiny_model().field.config, seed=number))
    monkeypatch.setattr(architectures, "Trainer", FakeTrainer)
    for index in range(4):
        write_object(tmp_path / "data", views_of(tiny_model(), index, 3))
    write_manifest(tmp_path / "data", "stools", {f"stool{i}": (f"s{i}", f"t{i}") for i in range(4)})
    (tmp_path / "models").mkdir()
    return given


def measured(folder: Path) -> ArchitectureResults:
    *said, found = measure_architectures([folder / "data"], 20, folder / "models")
    assert said
    assert isinstance(found, ArchitectureResults)
    return found


def test_every_architecture_is_scored_shown_written_and_drawn_again(tmp_path: Path, given: Given) -> None:
    found = measured(tmp_path)
    assert given == [replace(RECIPES[one], steps=20) for one in ARCHITECTURES.values()]
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


def test_a_model_is_trained_once_anew_at_another_size_and_never_taken_for_one_of_other_objects(
    tmp_path: Path, given: Given, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = measured(tmp_path)
    assert measured(tmp_path).rows == first.rows and len(given) == 3
    larger = replace(RECIPES["M2"].field, density_scale=31.0)
    monkeypatch.setitem(RECIPES, "M2", replace(RECIPES["M2"], field=larger))
    measured(tmp_path)
    assert len(given) == 4 and given[-1].field == larger
    shutil.rmtree(tmp_path / "data/stool3")
    with pytest.raises(ValueError, match=r"stools-M1-20\.safetensors was trained on other objects"):
        measured(tmp_path)


def paint_opacities(monkeypatch: pytest.MonkeyPatch, *opacities: float) -> None:
    """One after the other, and again from the first."""
    turns = itertools.cycle(opacities)

    def render(model: Model, codes: Codes, camera: Camera, samples: int) -> Rendered:
        found = render_exact(model, codes, camera, 2)
        return replace(found, opacity=torch.full_like(found.opacity, next(turns)))

    monkeypatch.setattr(architectures, "render_exact", render)


@pytest.mark.usefixtures("given")
def test_what_another_texture_does_to_the_opacity_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paint_opacities(monkeypatch, 0.6, 0.7)
    for one in measured(tmp_path).rows:
        assert one.opacity_change.mean == pytest.approx(0.1)


@pytest.mark.usefixtures("given")
def test_a_model_that_shows_nothing_yet_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paint_opacities(monkeypatch, 0.0)
    with pytest.raises(ValueError, match="train it for more steps"):
        measured(tmp_path)
