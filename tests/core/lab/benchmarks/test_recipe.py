from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from core.lab.benchmarks import recipe, trained_models
from core.lab.benchmarks.recipe import DEFAULT, VARIANTS, RecipeScore, measure_recipe
from core.lab.datasets.srn import Dataset, index_objects, read_dataset
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import TrainStep
from core.models.model import Model
from tests.core.lab.benchmarks.test_trained_models import train_nothing
from tests.core.tiny import tiny_model


def test_every_variant_differs_in_one_part() -> None:
    default = RECIPES["default"]
    assert next(iter(VARIANTS)) == DEFAULT and not VARIANTS[DEFAULT]
    for name, change in VARIANTS.items():
        if name != DEFAULT:
            ((part, value),) = change.items()
            assert getattr(default, part) != value
            assert getattr(replace(default, **change), part) == value  # type: ignore[arg-type]


def test_each_variant_is_trained_for_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders, entries, _ = train_nothing(tmp_path, monkeypatch)
    now, cost = 0.0, {"AdamW": 0.1, "Muon": 0.25}

    class SlowTrainer:
        """A trainer whose steps take what they say on a clock of its own."""

        def __init__(self, dataset: Dataset, settings: TrainSettings) -> None:
            self.settings, self.step = settings, 0

        def steps(self) -> Iterator[TrainStep]:
            nonlocal now
            while self.step < self.settings.steps:
                self.step += 1
                now += cost["AdamW" if self.settings.muon_lr is None else "Muon"]
                yield TrainStep(self.step, self.settings.steps, 0.1, 20.0, now)

        def model(self) -> Model:
            return tiny_model()

    monkeypatch.setattr(recipe, "Trainer", SlowTrainer)
    monkeypatch.setattr(recipe.time, "process_time", lambda: now)
    some = set(VARIANTS) - {DEFAULT, "AdamW instead of Muon"}
    found = list(measure_recipe(read_dataset(folders), entries[:2], 30, some))
    assert [(one.name, one.steps) for one in found] == [(DEFAULT, 120), ("AdamW instead of Muon", 300)]
    assert all(one.seconds == pytest.approx(30) for one in found)
    assert all(len(one.held_out) == 2 and one.gain(found[0]).mean == 0 for one in found)  # the same model
    assert trained_models.held_out_psnrs(tiny_model(), index_objects(folders)[1][:2]) == found[0].held_out


def test_a_gain_is_positive_where_a_recipe_is_better() -> None:
    default, better = (RecipeScore("", 1, 1.0, 20.0, held_out) for held_out in ((20.0, 30.0), (21.0, 33.0)))
    assert better.gain(default).mean == 2
    assert default.gain(better).mean == -2
