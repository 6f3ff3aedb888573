"""The value of each component of a blind fit: the ``normal`` preset, and the same without one component at a time.

All methods fit a view one right after the other, and each is compared with the full fits of that view: views differ far
more than components. The full method has several seeds: one lucky seed would make every component look valuable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, median

import torch

from core.fitting.settings import PRESETS, Components
from core.lab.benchmarks.fits import FitMethod, FitSummary, FitTrial, summarise_fits
from core.lab.evaluation.statistics import Mean, mean_gain

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
    "without distinct basins": FitMethod(_USUAL, Components(distinct_basins=False)),
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


def summarise_ablations(trials: Sequence[FitTrial]) -> tuple[Ablation, ...]:
    """Return a row per method in the order of the trials, each over the views it was measured on."""
    by_name: dict[str, dict[tuple[str, int], FitTrial]] = {
        name: {} for name in dict.fromkeys(trial.preset for trial in trials)
    }
    for trial in trials:
        by_name[trial.preset][trial.name, trial.view] = trial
    return tuple(_ablation(name, by_name) for name in by_name)


def _ablation(name: str, by_name: Mapping[str, Mapping[tuple[str, int], FitTrial]]) -> Ablation:
    trials = by_name[name]
    full = {view: [by_name[repeat][view] for repeat in REPEATS if repeat != name] for view in trials}
    gain = mean_gain([trial.held_out for trial in trials.values()], [_held_out(repeats) for repeats in full.values()])
    times = [trial.seconds / fmean(repeat.seconds for repeat in full[view]) for view, trial in trials.items()]
    return Ablation(summarise_fits(name, tuple(trials.values())), gain, median(times))


def _held_out(trials: Sequence[FitTrial]) -> float:
    return fmean(trial.held_out for trial in trials)
