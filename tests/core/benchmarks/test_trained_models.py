import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.benchmarks import trained_models
from core.benchmarks.trained_models import load_trained, score_model, trained_objects_views
from core.datasets.srn import Dataset, ObjectEntry, index_objects, write_manifest, write_object
from core.fitting.fit import PRESETS, FitSettings
from core.models.model import Model
from core.training.recipes import TrainSettings
from core.training.trainer import TrainStep
from tests.core.evaluation.test_protocol import views_of
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
            known, field = [entry.name for entry in model.codes.objects], copy.deepcopy(model.field)
            with torch.no_grad():
                field.colour_layer.bias += 0.3 * (len(known) - len(self._names))
            codes = model.codes.subset([known.index(name) for name in self._names])
            return replace(model, field=field, codes=codes)

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
    model, path = tiny_model(), tmp_path / "scores.json"
    views = trained_objects_views(entries, "stools", model)
    assert len(views.objects) == len(entries) and all(len(one.cameras) == 1 for one in views.objects)

    def scores(tests: Sequence[ObjectEntry]) -> tuple[list[str], trained_models.Scores]:
        said = []
        stream = score_model(model, views, tests, path)
        while True:
            try:
                said.append(next(stream))
            except StopIteration as end:
                return said, end.value

    said, first = scores(entries[:2])
    assert len(first.held_out) == len(first.found) == len(first.fit_seconds) == 2 and said
    assert scores(entries[:2]) == ([], first)
    said, _ = scores(entries[1:3])  # other tests are measured anew
    assert said


def test_a_model_of_other_objects_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, entries, _ = train_nothing(tmp_path, monkeypatch)
    tiny_model().save(tmp_path / "kept.safetensors")
    assert load_trained(tmp_path / "kept.safetensors", entries).fingerprint == tiny_model().fingerprint
    with pytest.raises(ValueError, match=r"kept\.safetensors was trained on other objects"):
        load_trained(tmp_path / "kept.safetensors", entries[1:])
