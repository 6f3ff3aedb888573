"""What each component of a blind fit is worth: the ``normal`` preset, and the same without one component at a time.

Every view is fitted in all these ways, one right after the other, and each is compared with the full fit of the same
view: views differ by far more than components do.
"""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from statistics import median

import torch

from core.benchmarks.fits import Summary, Trial, fit_view, summarise
from core.benchmarks.held_out_views import HeldOutView
from core.benchmarks.machine import describe_machine
from core.evaluation.statistics import Mean, mean_of
from core.fitting.settings import ALL_COMPONENTS, PRESETS, Components, FitSettings
from core.models.model import Model
from core.models.precision import use_dtype

FULL, _FLOAT32 = "full", "in float32"
_USUAL = PRESETS["normal"]
ABLATIONS: dict[str, tuple[FitSettings, Components]] = {
    FULL: (_USUAL, ALL_COMPONENTS),
    "without the view bank": (_USUAL, Components(view_bank=False, prototype_shapes=False)),
    "without the viewpoint classifier": (_USUAL, Components(viewpoint_classifier=False)),
    "without fresh codes for the local search": (_USUAL, Components(fresh_codes=False)),
    "without multi-start": (replace(_USUAL, hypotheses=1, max_restarts=0), ALL_COMPONENTS),
    "without a restart where in doubt": (replace(_USUAL, max_restarts=0), ALL_COMPONENTS),
    "without prototype shapes": (_USUAL, Components(prototype_shapes=False)),
    "without distinct basins": (_USUAL, Components(distinct_basins=False)),
    "without early stopping": (_USUAL, Components(early_stopping=False)),
    "without the code prior": (replace(_USUAL, code_prior=0.0), ALL_COMPONENTS),
    "without the camera prior": (_USUAL, Components(camera_prior=False)),
    "without the robust loss": (_USUAL, Components(robust_loss=False)),
    "without the mask loss": (_USUAL, Components(mask_loss=False)),
    _FLOAT32: (_USUAL, ALL_COMPONENTS),
}
"""All but the first leave something out."""


@dataclass(frozen=True)
class Ablation:
    """The preset without one component, beside the full one."""

    summary: Summary
    gain: Mean
    """dB, of the other views over what they are with the full preset"""
    time: float
    """times what the full preset takes; median"""


@dataclass(frozen=True)
class AblationResults:
    """Everything that one run found."""

    machine: str
    ablations: tuple[Ablation, ...]
    """:data:`FULL`, then without each component"""


def run(model: Model, targets: Sequence[HeldOutView]) -> Iterator[str | AblationResults]:
    """Yields what is being measured, and at the end the results."""
    trials: dict[str, list[Trial]] = {name: [] for name in ABLATIONS}
    for number, target in enumerate(targets):
        for name, (settings, components) in ABLATIONS.items():
            yield f"{target.views.name}, {name}"
            with use_dtype(torch.float32) if name == _FLOAT32 else nullcontext():
                trials[name].append(fit_view(model, target, name, settings, number, components))
    yield AblationResults(
        describe_machine(model.device), tuple(_ablation(name, trials[name], trials[FULL]) for name in ABLATIONS)
    )


def _ablation(name: str, trials: Sequence[Trial], full: Sequence[Trial]) -> Ablation:
    pairs = list(zip(trials, full, strict=True))
    gain = mean_of([one.held_out - other.held_out for one, other in pairs])
    return Ablation(summarise(name, trials), gain, median(one.seconds / other.seconds for one, other in pairs))
