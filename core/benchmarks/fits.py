"""Seconds against degrees: blind fits by every preset, on views whose cameras are known.

One view of every object is fitted without its camera; the stream's own timestamps make the curves. What the
same fits know of themselves, in the end, calibrates :mod:`core.fitting.confidence`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median

import numpy as np

from core.benchmarks.held_out_views import OTHERS, Subject, looks_alike
from core.benchmarks.rendering import machine
from core.evaluation.protocol import Mean, compared, mean_of, photo
from core.fitting.confidence import RIGHT_DEGREES, Calibration, auroc, fit_calibration
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep, fit
from core.fitting.settings import ALL_COMPONENTS, Components
from core.metrics import rotation_error, translation_error
from core.models.model import Model
from core.photos.view_bank import view_bank

_FAR = 20.0
"""degrees: a camera that is further off may be another right one"""
_ALIKE = 5.0
"""degrees: if the object looks no less alike than when turned by this"""
TIMES = tuple(0.25 * 2 ** (0.5 * index) for index in range(20))
"""s, at which the curves are read"""


@dataclass(frozen=True)
class Trial:
    """One fit of one view."""

    preset: str
    name: str
    view: int
    seconds: float
    first_rotation: float
    """degrees, after the first step"""
    rotation: float
    """degrees"""
    translation: float
    """share of the true distance"""
    psnr: float
    """dB, of the picture itself"""
    held_out: float
    """dB, mean over some other views, from their true cameras"""
    margin: float | None
    """over the alternative; None where there is none"""
    uncertainty: float | None
    """degrees, as in :class:`core.fitting.fit.FitStep`"""
    confidence: float | None
    trace: tuple[float, ...]
    """degrees at :data:`TIMES`"""
    symmetric: bool
    """far off, and yet the object looks as from its true camera, as far as the model knows it"""

    @property
    def off(self) -> float:
        """Degrees, but 0 for another camera that is as right."""
        return 0.0 if self.symmetric else self.rotation


@dataclass(frozen=True)
class Summary:
    """A preset over all views."""

    preset: str
    fits: int
    seconds: float
    """median"""
    first_rotation: float
    """degrees, mean"""
    rotation: float
    """degrees, median"""
    symmetric: int
    """cameras that count as right for the object's symmetry"""
    within_5_degrees: Mean
    within_10_degrees: Mean
    within_3_percent: Mean
    held_out: Mean
    """dB"""
    separation: float | None
    """of right cameras from wrong ones by the confidence (AUROC); None where it has none, or all are right or wrong"""
    curve: tuple[tuple[float, float, float], ...]
    """seconds, median rotation error in degrees, share within 5 degrees"""


@dataclass(frozen=True)
class Measured:
    """Everything that one run found."""

    machine: str
    trials: tuple[Trial, ...]
    summaries: tuple[Summary, ...]
    calibration: Calibration | None
    """that these fits would give the confidence; None where all were right, or all wrong"""

    def told(self) -> dict:
        """As plain values."""
        return asdict(self)


def measured(
    model: Model, subjects: Sequence[Subject], presets: dict[str, FitSettings] = PRESETS
) -> Iterator[str | Measured]:
    """What is being measured now, and in the end all that was found. To stop, ask for no more."""
    yield "view bank"
    view_bank(model)
    trials = list[Trial]()
    for number, subject in enumerate(subjects):
        for name, settings in presets.items():
            yield f"{subject.views.name}, {name}"
            trials.append(trial(model, subject, name, settings, number))
    summaries = tuple(summary(name, [one for one in trials if one.preset == name]) for name in presets)
    yield Measured(machine(model.device), tuple(trials), summaries, _calibration(trials))


def trial(
    model: Model,
    subject: Subject,
    preset: str,
    settings: FitSettings,
    seed: int,
    components: Components = ALL_COMPONENTS,
) -> Trial:
    """Fit a subject's view without its camera. ``preset`` is only a name."""
    views, index = subject.views, subject.view
    steps = list(fit(model, FitJob((photo(views, index, False),), settings, seed, components=components)))
    last, errors = steps[-1], [rotation_error(step.cameras[0], subject.camera) for step in steps]
    rest = [other for other in range(len(views.cameras)) if other != index]
    some = rest[:: max(1, len(rest) // OTHERS)][:OTHERS]
    held_out = [compared(model, last.codes, views, other)[0] for other in some]
    away = translation_error(last.cameras[0], subject.camera)
    quality = last.psnr, float(np.mean(held_out)) if held_out else math.nan
    trace = tuple(errors[_reached(steps, time)] for time in TIMES)
    symmetric = errors[-1] > _FAR and looks_alike(model, subject.codes, last.cameras[0], subject.camera, _ALIKE)
    turned, trust = (errors[0], errors[-1]), (last.margin, last.uncertainty, last.confidence)
    return Trial(preset, views.name, index, last.seconds, *turned, away, *quality, *trust, trace, symmetric)


def _reached(steps: Sequence[FitStep], seconds: float) -> int:
    """The step that a fit had reached by then; before its first, the first."""
    return max((index for index, step in enumerate(steps) if step.seconds <= seconds), default=0)


def summary(preset: str, trials: Sequence[Trial]) -> Summary:
    """What the fits of one preset come to."""

    def share(values: Sequence[float], most: float) -> Mean:
        return mean_of([float(value <= most) for value in values])

    turns = [trial.off for trial in trials]
    shifts = [0.0 if trial.symmetric else trial.translation for trial in trials]
    curve = []
    for number, time in enumerate(TIMES):
        then = [trial.trace[number] for trial in trials]
        curve.append((time, median(then), share(then, 5.0).mean))
    return Summary(
        preset,
        len(trials),
        median(trial.seconds for trial in trials),
        float(np.mean([trial.first_rotation for trial in trials])),
        median(trial.rotation for trial in trials),
        sum(trial.symmetric for trial in trials),
        share(turns, 5.0),
        share(turns, 10.0),
        share(shifts, 0.03),
        mean_of([trial.held_out for trial in trials]),
        _separation(trials),
        tuple(curve),
    )


def _separation(trials: Sequence[Trial]) -> float | None:
    told = [(trial.confidence, trial.off <= RIGHT_DEGREES) for trial in trials if trial.confidence is not None]
    right = [one for _, one in told]
    return auroc([one for one, _ in told], right) if len(set(right)) == 2 else None


def _calibration(trials: Sequence[Trial]) -> Calibration | None:
    told = [trial for trial in trials if trial.confidence is not None]
    right = [trial.off <= RIGHT_DEGREES for trial in told]
    if len(set(right)) < 2:
        return None
    return fit_calibration([trial.margin or 0.0 for trial in told], [trial.uncertainty or 0.0 for trial in told], right)
