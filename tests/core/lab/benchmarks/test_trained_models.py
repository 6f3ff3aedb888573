import copy
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.fitting.fit import PRESETS, FitSettings
from core.lab.benchmarks import trained_models
from core.lab.benchmarks.trained_models import (
    Scores,
    TrainedModel,
    Variant,
    score_variants,
    train_variants,
    trained_objects_views,
)
from core.lab.datasets.srn import Dataset, ObjectEntry, index_objects, write_manifest, write_object
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import TrainStep
from core.models.model import Model
from core.streams import run_to_end
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model

Given = list[tuple[Dataset, TrainSettings]]


def train_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[Path], Sequence[ObjectEntry], Given]:
    """A dataset of four objects in ``data``, quick fits, and a trainer that needs no steps.

    Its model is the worse the fewer objects there are. Returns the folders of the dataset, its objects, and what every
    trainer is given.
    """
    given: Given = []

    class FakeTrainer:
        def __init__(self, dataset: Dataset, settings: TrainSettings) -> None:
            given.append((dataset, settings))
            self._names = [views.name for views in dataset.objects]

        def steps(self) -> Iterator[TrainStep]:
            return iter(())

        def model(self) -> Model:
            model = tiny_model()
            known, field = model.codes.objects, copy.deepcopy(model.field)
            with torch.no_grad():
                field.colour_layer.bias += 0.3 * (len(known) - len(self._names))
            objects = tuple(entry for entry in known if entry.name in self._names)
            return replace(model, field=field, codes=replace(model.codes, objects=objects))

    for number, name in enumerate(("default", "M1", "M2")):  # all of the tiny model's network, and yet to be told apart
        monkeypatch.setitem(RECIPES, name, replace(RECIPES[name], field=tiny_model().field.config, seed=number))
    for preset in ("draft", "normal"):
        monkeypatch.setitem(PRESETS, preset, FitSettings(hypotheses=2, steps=5, rays=32, samples=8))
    monkeypatch.setattr(trained_models, "Trainer", FakeTrainer)
    for index in range(4):
        write_object(folder / "data", replace(views_of(tiny_model(), index, 3), name=f"stool{index}"))
    write_manifest(folder / "data", "stools", {f"stool{i}": (f"s{i}", f"t{i}") for i in range(4)})
    (folder / "models").mkdir()
    return [folder / "data"], index_objects([folder / "data"])[1], given


def test_scores_are_kept_with_their_model_and_tests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, entries, _ = train_nothing(tmp_path, monkeypatch)
    model = tiny_model()
    views = trained_objects_views(entries, "stools", model)
    assert len(views.objects) == len(entries) and all(len(one.cameras) == 1 for one in views.objects)

    def stream(tests: Sequence[ObjectEntry]) -> Generator[str, None, list[Scores]]:
        return score_variants([TrainedModel(tmp_path / "m.safetensors", model)], views, tests)

    (first,) = run_to_end(stream(entries[:2]))
    assert len(first.held_out) == len(first.found) == len(first.fit_seconds) == 2
    assert list(stream(entries[:2])) == []  # nothing is measured
    assert run_to_end(stream(entries[:2])) == [first]
    assert list(stream(entries[1:3]))  # other tests are measured anew


def test_a_variant_is_trained_once_anew_at_another_size_and_never_taken_for_one_of_other_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders, entries, given = train_nothing(tmp_path, monkeypatch)
    settings = replace(RECIPES["default"], steps=20)

    def trained(settings: TrainSettings, entries: Sequence[ObjectEntry]) -> Model:
        (one,) = run_to_end(train_variants(folders, [Variant("kept", settings, entries)], tmp_path))
        assert one.path == tmp_path / "kept-20.safetensors"
        return one.model

    first = trained(settings, entries)
    assert trained(settings, entries).fingerprint == first.fingerprint and len(given) == 1
    with pytest.raises(ValueError, match=r"kept-20\.safetensors was trained on other objects"):
        trained(settings, entries[1:])
    trained(replace(settings, field=replace(settings.field, width=8)), entries)
    assert len(given) == 2
