"""The value of each component of a blind fit: the ``normal`` preset, and the same without one component at a time.

Every view is fitted in all these ways, one right after the other, and each is compared with the full fit of the same
view: views differ by far more than components do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median

import torch

from core.fitting.settings import PRESETS, Components
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.fits import FitMethod, FitSummary, FitTrial, fit_views, summarise_fits
from core.lab.benchmarks.held_out_views import HeldOutView
from core.lab.benchmarks.machine import describe_machine
from core.lab.evaluation.statistics import Mean, mean_gain
from core.models.model import Model

FULL = "full"
_USUAL = PRESETS["normal"]
ABLATIONS: dict[str, FitMethod] = {
    FULL: FitMethod(_USUAL),
    "without the view bank": FitMethod(_USUAL, Components(view_bank=False, prototype_shapes=False)),
    "without the viewpoint classifier": FitMethod(_USUAL, Components(viewpoint_classifier=False)),
    "without fresh codes for the local search": FitMethod(_USUAL, Components(fresh_codes=False)),
    "without multi-start": FitMethod(replace(_USUAL, hypotheses=1, max_restarts=0)),
    "without a restart where in doubt": FitMethod(replace(_USUAL, max_restarts=0)),
    "without prototype shapes": FitMethod(_USUAL, Components(prototype_shapes=False)),
    "without distinct basins": FitMethod(_USUAL, Components(distinct_basins=False)),
    "without early stopping": FitMethod(_USUAL, Components(early_stopping=False)),
    "without the code prior": FitMethod(replace(_USUAL, code_prior=0.0)),
    "without the camera prior": FitMethod(_USUAL, Components(camera_prior=False)),
    "without the robust loss": FitMethod(_USUAL, Components(robust_loss=False)),
    "without the mask loss": FitMethod(_USUAL, Components(mask_loss=False)),
    "in float32": FitMethod(_USUAL, dtype=torch.float32),
}
"""All but the first leave something out."""


@dataclass(frozen=True)
class Ablation:
    """The preset without one component, beside the full one."""

    summary: FitSummary
    gain: Mean
    """dB, of the other views over what they are with the full preset"""
    time: float
    """times what the full preset takes; median"""


def measure_ablations(model: Model, targets: Sequence[HeldOutView]) -> Iterator[str | Results[Ablation]]:
    """Yields what is being measured, and at the end the results: :data:`FULL`, then without each component."""
    trials = yield from fit_views(model, targets, ABLATIONS)
    by_name = {name: [trial for trial in trials if trial.preset == name] for name in ABLATIONS}
    found = tuple(_ablation(name, some, by_name[FULL]) for name, some in by_name.items())
    yield Results({"machine": describe_machine(model.device)}, found)


def _ablation(name: str, trials: Sequence[FitTrial], full: Sequence[FitTrial]) -> Ablation:
    gain = mean_gain([one.held_out for one in trials], [one.held_out for one in full])
    times = [one.seconds / other.seconds for one, other in zip(trials, full, strict=True)]
    return Ablation(summarise_fits(name, trials), gain, median(times))
