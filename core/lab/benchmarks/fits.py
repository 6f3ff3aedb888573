"""Seconds against degrees: blind fits by every preset, on views whose cameras are known.

One view of every object is fitted without its camera; the time stamps of the steps make the curves. The margins and
uncertainties of these fits calibrate :mod:`core.fitting.confidence`.
"""

import math
import time
from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch

from core.fitting.confidence import RIGHT_DEGREES, Calibration, auroc, fit_calibration
from core.fitting.fit import FitJob, FitSettings, FitStep
from core.fitting.paper import fit_as_set
from core.fitting.settings import ALL_COMPONENTS, Components
from core.lab.benchmarks.held_out_views import HELD_OUT_VIEWS, HeldOutView, is_symmetric_view
from core.lab.datasets.srn import ObjectViews
from core.lab.evaluation.protocol import ViewScore, as_photo, score_view
from core.lab.evaluation.statistics import Mean, fraction_within, mean_of
from core.metrics import rotation_error, translation_error
from core.models.model import Model
from core.runtime.precision import use_dtype

SURE_FROM = 0.8  # confidence above which no camera is to be wrong
_FAR = 20.0  # degrees: a camera further off may still be right by symmetry
_SYMMETRY_TOLERANCE = 5.0  # degrees: a view is symmetric if it matches the true one as well as a turn by this does
KEY = "preset", "name", "view"  # of a trial
BANDS = (0.0, 0.5, 0.7, 0.8, 0.9, 1.0)  # edges of bands of confidence
TIMES = tuple(0.25 * 2 ** (0.5 * index) for index in range(20))  # s, at which the curves are read


@dataclass(frozen=True)
class FitTrial:
    """A fit of one view and its errors."""

    preset: str
    name: str  # of the object
    view: int
    seconds: float  # processor time, unaffected by other programs; wall-clock time on a graphics card
    initial_rotation: float  # degrees, error after the first step
    rotation: float  # degrees, error of the fitted camera
    translation: float  # error as a fraction of the true distance
    psnr: float  # dB, of the fitted image
    held_out: float  # dB, mean over the held-out views, from their true cameras
    restarted: bool  # the camera was in doubt after the first search
    margin: float | None  # over the runner-up; None without one
    uncertainty: float | None  # degrees, as in FitStep
    confidence: float | None
    rotation_curve: tuple[float, ...]  # degrees, error at TIMES
    symmetric: bool  # far off, but a render from this camera is nearly the one from the true camera
    whole: ViewScore | None = None  # mean of the held-out views at the dataset's size

    def __str__(self) -> str:
        return f"{self.name}, {self.preset}: {self.rotation:.1f} degrees after {self.seconds:.1f} s"


@dataclass(frozen=True)
class FitSummary:
    """The results of a preset over all views."""

    preset: str
    fits: int
    seconds: float  # median
    initial_rotation: float  # degrees, mean
    rotation: float  # degrees, median
    symmetric: int  # number of cameras that are right by the object's symmetry
    within_5_degrees: Mean
    within_10_degrees: Mean
    within_3_percent: Mean
    held_out: Mean  # dB
    photo: float  # dB, of the fitted images
    restarts: float  # fraction of fits
    wrong_sure: int  # number of wrong cameras with a confidence above SURE_FROM
    auroc: float | None
    """of the confidence, right cameras against wrong ones; None without confidence, or if all are right or wrong"""
    whole: ViewScore | None  # mean of the held-out views at the dataset's size
    curve: tuple[tuple[float, float, float], ...]  # seconds, median rotation error (degrees), fraction within 5 degrees


class FitMethod(NamedTuple):
    """One way to fit."""

    settings: FitSettings
    components: Components = ALL_COMPONENTS
    dtype: torch.dtype | None = None  # of multiplications; None for the machine's
    seed: int = 0  # of its random numbers, added to the view's


def fit_views(
    model: Model,
    targets: Sequence[HeldOutView],
    methods: Mapping[str, FitMethod],
    done: Collection[tuple[str, str, int]] = (),
) -> Iterator[FitTrial]:
    """Fit every view by all methods, one right after the other, and yield each trial.

    Args:
        done: keys of trials that are left out.
    """
    for number, target in enumerate(targets):
        for name, method in methods.items():
            if (name, target.views.name, target.index) in done:
                continue
            with use_dtype(method.dtype) if method.dtype else nullcontext():
                trial = fit_view(model, target, name, method, number + method.seed)
            yield trial


def fit_view(model: Model, target: HeldOutView, preset: str, method: FitMethod, seed: int) -> FitTrial:
    """Fit a view without its camera and compare with the truth. ``preset`` is only a name."""
    views = target.views
    job = FitJob((as_photo(views, target.index, False),), method.settings, seed, components=method.components)
    clock = time.perf_counter if model.device.type == "cuda" else time.process_time
    steps = list[FitStep]()
    seconds = list[float]()
    began = clock()
    for step in fit_as_set(model, job):
        steps.append(step)
        seconds.append(clock() - began)
    last = steps[-1]
    errors = [rotation_error(step.cameras[0], target.camera) for step in steps]
    held_out = _held_out_views(views, target.index)
    scores = [score_view(last.instance, views, index) for index in held_out]
    full_size = target.full_size
    full_size_scores = [score_view(last.instance, full_size, index) for index in held_out] if full_size else scores
    symmetric = errors[-1] > _FAR and is_symmetric_view(
        target.instance, last.cameras[0], target.camera, _SYMMETRY_TOLERANCE
    )
    return FitTrial(
        preset,
        views.name,
        target.index,
        seconds=seconds[-1],
        initial_rotation=errors[0],
        rotation=errors[-1],
        translation=translation_error(last.cameras[0], target.camera),
        psnr=last.psnr,
        restarted=any(step.restart for step in steps),
        held_out=float(np.mean([score.psnr for score in scores])) if scores else math.nan,
        margin=last.margin,
        uncertainty=last.uncertainty,
        confidence=last.confidence,
        rotation_curve=tuple(errors[_step_at(seconds, moment)] for moment in TIMES),
        symmetric=symmetric,
        whole=ViewScore(*np.mean(full_size_scores, axis=0).tolist()) if scores else None,
    )


def _held_out_views(views: ObjectViews, fitted: int) -> list[int]:
    """Return the indices of evenly spaced views other than the fitted one."""
    remaining = [index for index in range(len(views.cameras)) if index != fitted]
    return remaining[:: max(1, len(remaining) // HELD_OUT_VIEWS)][:HELD_OUT_VIEWS]


def _step_at(seconds: Sequence[float], moment: float) -> int:
    """Return the index of the last step finished by then; 0 before the first."""
    return max(0, bisect_right(seconds, moment) - 1)


def summarise_presets(trials: pd.DataFrame) -> tuple[FitSummary, ...]:
    """Return one summary per preset, in the order of the trials."""
    return tuple(summarise_fits(str(name), group) for name, group in trials.groupby("preset", sort=False))


def summarise_fits(preset: str, trials: pd.DataFrame) -> FitSummary:
    """Return medians and fractions over the trials of one preset."""
    curves = trials.filter(regex=r"^rotation_curve\.")
    rotations = effective_rotations(trials)
    return FitSummary(
        preset,
        len(trials),
        trials.seconds.median(),
        trials.initial_rotation.mean(),
        trials.rotation.median(),
        int(trials.symmetric.sum()),
        fraction_within(rotations, 5.0),
        fraction_within(rotations, 10.0),
        fraction_within(trials.translation.mask(trials.symmetric, 0.0), 0.03),
        mean_of(trials.held_out),
        trials.psnr.mean(),
        trials.restarted.mean(),
        int(((rotations > RIGHT_DEGREES) & (trials.confidence.fillna(0.0) > SURE_FROM)).sum()),
        _confidence_auroc(trials),
        ViewScore(*(trials[f"whole.{name}"].mean() for name in ViewScore._fields)) if "whole.psnr" in trials else None,
        tuple(zip(TIMES, curves.median(), (curves <= 5.0).mean(), strict=True)),
    )


def effective_rotations(trials: pd.DataFrame) -> pd.Series:
    """Return the rotation errors in degrees; 0 for cameras that are right by symmetry."""
    return trials.rotation.mask(trials.symmetric, 0.0)


def reliability(trials: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each band of confidence: fits, their mean confidence (stated) and fraction right (observed)."""
    rated = trials[trials.confidence.notna()]
    correct = effective_rotations(rated) <= RIGHT_DEGREES
    bands = pd.cut(rated.confidence, BANDS, include_lowest=True)
    grouped = pd.DataFrame({"stated": rated.confidence, "observed": correct}).groupby(bands, observed=True)
    return grouped.mean().assign(fits=grouped.size())


def calibrate_fits(trials: pd.DataFrame) -> Calibration | None:
    """Calibrate the confidence on these fits alone; return None if all cameras are right, or all wrong."""
    rated = trials[trials.confidence.notna()]
    correct = (effective_rotations(rated) <= RIGHT_DEGREES).tolist()
    if len(set(correct)) < 2:
        return None
    return fit_calibration(rated.margin.fillna(0.0).tolist(), rated.uncertainty.fillna(0.0).tolist(), correct)


def _confidence_auroc(trials: pd.DataFrame) -> float | None:
    rated = trials[trials.confidence.notna()]
    correct = (effective_rotations(rated) <= RIGHT_DEGREES).tolist()
    return auroc(rated.confidence.tolist(), correct) if len(set(correct)) == 2 else None
