"""The value of each part of the training recipe.

Models are trained for equal processor time, as their first steps predict it, and each differs from the default recipe
in one setting. Rays through the whole image do without the visual hulls, and without all that needs them.
"""

import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from core.lab.benchmarks.trained_models import held_out_psnrs
from core.lab.datasets.srn import Dataset, ObjectEntry
from core.lab.evaluation.statistics import Mean, mean_gain
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import Trainer, held_out_psnr, hold_out

DEFAULT = "default"
VARIANTS: dict[str, dict[str, float | bool | None]] = {
    DEFAULT: {},
    "AdamW instead of Muon": {"muon_lr": None},
    "Muon, a third of the rate": {"muon_lr": 3e-3},
    "Muon, thrice the rate": {"muon_lr": 3e-2},
    "half the rays": {"rays": 384},
    "twice the rays": {"rays": 1536},
    "rays through the whole image and box, as in the paper": {"whole_image": True},
    "without a penalty of empty space": {"outside_points": 0},
    "without masks": {"mask_weight": 0.0},
    "without averaged weights": {"ema_decay": 0.0},
}
"""Differences from the default recipe, by name."""
_PILOT_STEPS, _PILOT_WARMUP = 60, 20
"""How many steps tell how long one takes, and how many are made before."""


@dataclass(frozen=True)
class RecipeScore:
    """One model."""

    name: str
    steps: int
    """of training, in the time that all have"""
    seconds: float
    """of the processor, that they took"""
    new_views: float
    """dB, views not trained on of training objects"""
    held_out: tuple[float, ...]
    """dB, of each object never trained on: other views, fitted on one view from its true camera"""

    def gain(self, other: "RecipeScore") -> Mean:
        """dB over another model, of the same held-out objects."""
        return mean_gain(self.held_out, other.held_out)


def measure_recipe(
    dataset: Dataset, tests: Sequence[ObjectEntry], seconds: float, done: Collection[str]
) -> Iterator[RecipeScore]:
    """Yields a score per variant.

    Args:
        dataset: to train on; the last view of its objects is held out.
        tests: objects that are not in it.
        seconds: of the processor, for each.
        done: names that are left out.
    """
    kept, new_views = hold_out(dataset)
    for name, change in VARIANTS.items():
        if name in done:
            continue
        settings = replace(RECIPES["default"], **change)  # type: ignore[arg-type]
        trainer = Trainer(kept, replace(settings, steps=_steps_within(seconds, kept, settings)))
        began = time.process_time()
        for _ in trainer.steps():
            pass
        taken, model = time.process_time() - began, trainer.model()
        psnr = held_out_psnr(model, new_views)
        yield RecipeScore(name, trainer.step, taken, psnr, held_out_psnrs(model, tests))


def _steps_within(seconds: float, dataset: Dataset, settings: TrainSettings) -> int:
    """How many steps take so long, by the first steps of a run that is thrown away."""
    trial, began = Trainer(dataset, replace(settings, steps=_PILOT_STEPS)), 0.0
    for step in trial.steps():
        if step.step == _PILOT_WARMUP:
            began = time.process_time()
    each = (time.process_time() - began) / (_PILOT_STEPS - _PILOT_WARMUP)
    return max(1, round(seconds / each))
