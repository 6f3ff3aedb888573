"""What every part of a blind fit is worth: the ``normal`` preset, and the same without one part at a time.

Every view is fitted in all these ways, one right after the other, and each is compared with the whole on the same view:
views differ by far more than parts do.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import median

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from core.benchmarks.fits import Summary, Trial, fit_view, summarise
from core.benchmarks.held_out_views import HeldOutView, random_camera
from core.benchmarks.machine import describe_machine
from core.benchmarks.patched import Change, changed
from core.evaluation.statistics import Mean, mean_of
from core.fitting import gauss_newton as newton
from core.fitting import hypotheses
from core.fitting import initial as entrants
from core.fitting import schedule as plan
from core.fitting import search as race
from core.fitting.hypotheses import Pool
from core.fitting.schedule import PRESETS, FitSettings
from core.models import precision
from core.models.model import Model
from core.photos import view_bank as starts
from core.photos.view_bank import Bank, Starts, bank_of
from core.rendering import folded_field as folded
from core.rendering import jacobian as slopes

WHOLE = "nothing left out"


@dataclass(frozen=True)
class Part:
    """The preset without something, beside the whole of it."""

    summary: Summary
    gain: Mean
    """dB, of the other views over what they are with the whole preset"""
    time: float
    """times what the whole preset takes; median"""


@dataclass(frozen=True)
class Measured:
    """Everything that one run found."""

    machine: str
    parts: tuple[Part, ...]
    """:data:`WHOLE`, then without each part"""

    def told(self) -> dict:
        """As plain values."""
        return asdict(self)


def measured(model: Model, targets: Sequence[HeldOutView]) -> Iterator[str | Measured]:
    """What is being measured now, and in the end all that was found. To stop, ask for no more."""
    yield "bank of views"
    bank_of(model)
    trials: dict[str, list[Trial]] = {name: [] for name in _PARTS}
    for number, target in enumerate(targets):
        for name, (settings, changes) in _PARTS.items():
            yield f"{target.views.name}, {name}"
            with changed(changes):
                trials[name].append(fit_view(model, target, name, settings, number))
    yield Measured(describe_machine(model.device), tuple(_part(name, trials[name], trials[WHOLE]) for name in _PARTS))


def _part(name: str, trials: Sequence[Trial], whole: Sequence[Trial]) -> Part:
    pairs = list(zip(trials, whole, strict=True))
    gain = mean_of([one.held_out - other.held_out for one, other in pairs])
    return Part(summarise(name, trials), gain, median(one.seconds / other.seconds for one, other in pairs))


def _anywhere(
    bank: Bank,
    model: Model,
    pixels: Tensor,
    mask: Tensor,
    focal: float,
    count: int,
    framed: bool = False,
    beyond: Tensor | None = None,
) -> Starts:
    """In place of the cameras that promise most: as :func:`core.photos.view_bank.ranked`."""
    generator = torch.Generator().manual_seed(int(mask.sum()))
    cameras = [random_camera(model, generator) for _ in range(count)]
    numbers = torch.tensor([(camera.azimuth, camera.elevation, camera.distance) for camera in cameras])
    nowhere = torch.zeros(count, 2)
    return Starts(numbers[:, 0], numbers[:, 1], numbers[:, 2], nowhere, torch.zeros(count, dtype=torch.long))


def _cheapest(pool: Pool, views: Bool[Tensor, "views"]) -> Int[Tensor, "some"]:
    """In place of the best of each basin."""
    order = pool.cost.argsort(stable=True)
    return order[pool.cost[order].isfinite()]


def _everywhere(name: str, value: object, *owners: object) -> tuple[Change, ...]:
    return tuple(Change(owner, name, value) for owner in owners)


_USUAL = PRESETS["normal"]
_STAGES = len(plan._STEPS)
_PARTS: dict[str, tuple[FitSettings, tuple[Change, ...]]] = {
    WHOLE: (_USUAL, ()),
    "without the bank: starts random_camera": (
        _USUAL,
        (Change(entrants, "ranked", _anywhere), Change(entrants, "_LIKENESS", 0.0)),
    ),
    "without a glance at the picture": (
        _USUAL,
        (Change(race, "_glanced", lambda model, photo: None), Change(starts, "_GLANCE_SHARE", 0.0)),
    ),
    "without beginning anew: codes go on": (
        _USUAL,
        (Change(race, "renewed", lambda model, photos, given, pool, count: pool),),
    ),
    "without the race: the best start alone": (replace(_USUAL, starts=1, races=1), ()),
    "no second look at a doubtful camera": (replace(_USUAL, races=1), ()),
    "without shapes from the bank": (_USUAL, _everywhere("_LIKENESS", 0.0, entrants)),
    "without telling basins apart": (_USUAL, _everywhere("spread_out", _cheapest, entrants, race)),
    "without a second one in the last stage": (_USUAL, _everywhere("_CLOSE", -math.inf, race)),
    "all code directions from the beginning": (_USUAL, _everywhere("_RANKS", (10_000,) * _STAGES, plan)),
    "no asking what pays": (replace(_USUAL, sparing=False), ()),
    "without a prior of codes": (replace(_USUAL, prior=0.0), ()),
    "without a prior of cameras": (_USUAL, _everywhere("STRAY_PRIORS", (0.0, 0.0, 0.0), hypotheses, newton)),
    "forgiving nothing": (_USUAL, _everywhere("_FORGIVING", (math.inf,) * _STAGES, plan)),
    "without the silhouette": (_USUAL, _everywhere("SILHOUETTE", 0.0, hypotheses, newton)),
    "in float32": (
        _USUAL,
        _everywhere("matmul_dtype", lambda device: torch.float32, folded, newton, precision, slopes),
    ),
}
