"""The value of each component of a blind fit: the ``normal`` preset, and the same without one component at a time.

All methods fit a view one right after the other, and each is compared with the full fits of that view: views differ far
more than components. The full method has several seeds: one lucky seed would make every component look valuable.
"""

from dataclasses import dataclass, replace

import pandas as pd
import torch

from core.fitting.settings import PRESETS, Components
from core.lab.benchmarks.fits import FitMethod, FitSummary, summarise_fits
from core.lab.evaluation.statistics import Mean, mean_of

FULL = "full"
_USUAL = PRESETS["normal"]
REPEATS: dict[str, FitMethod] = {
    FULL: FitMethod(_USUAL),
    "full, second seed": FitMethod(_USUAL, seed=1000),
    "full, third seed": FitMethod(_USUAL, seed=2000),
}
ABLATIONS: dict[str, FitMethod] = {
    **REPEATS,
    "without the view bank": FitMethod(_USUAL, Components(view_bank=False)),
    "without the viewpoint classifier": FitMethod(_USUAL, Components(viewpoint_classifier=False)),
    "without fresh codes for the local search": FitMethod(_USUAL, Components(fresh_codes=False)),
    "without multi-start": FitMethod(replace(_USUAL, hypotheses=1, max_restarts=0)),
    "without a restart where in doubt": FitMethod(replace(_USUAL, max_restarts=0)),
    "without prototype shapes": FitMethod(_USUAL, Components(prototype_shapes=False)),
    "without free biases": FitMethod(replace(_USUAL, free_steps=0)),
    "without the code prior": FitMethod(replace(_USUAL, code_prior=0.0)),
    "without the camera prior": FitMethod(_USUAL, Components(camera_prior=False)),
    "without the robust loss": FitMethod(_USUAL, Components(robust_loss=False)),
    "without the mask loss": FitMethod(_USUAL, Components(mask_loss=False)),
    "in float32": FitMethod(_USUAL, dtype=torch.float32),
}  # except for the repeats, each leaves something out


@dataclass(frozen=True)
class Ablation:
    """The preset without one component, against the mean of the full fits of the same views.

    A single full fit in its place shows the noise.
    """

    summary: FitSummary
    gain: Mean  # dB on other views, over the full preset
    time: float  # multiple of the full preset's time, median


def summarise_ablations(trials: pd.DataFrame) -> tuple[Ablation, ...]:
    """Return a row per method in the order of the trials, each over the views it was measured on."""
    return tuple(_ablation(str(name), own, trials) for name, own in trials.groupby("preset", sort=False))


def _ablation(name: str, own: pd.DataFrame, trials: pd.DataFrame) -> Ablation:
    repeats = trials[trials.preset.isin(REPEATS) & (trials.preset != name)]
    full = repeats.groupby(["name", "view"])[["held_out", "seconds"]].mean()
    compared = own.merge(full, on=["name", "view"], suffixes=("", "_full"))
    gain = mean_of(compared.held_out - compared.held_out_full)
    return Ablation(summarise_fits(name, own), gain, (compared.seconds / compared.seconds_full).median())
