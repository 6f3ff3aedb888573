"""Failures of fits: images corrupted in one way at a time, fitted without their camera.

A corrupted image enters a fit as a user's photo does: it is segmented by its alpha channel, or else by its background.
Trials are measured in a fixed order, so a run can be resumed; runs of other stressors may share its file.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from PIL import Image

from core.fitting.confidence import DOUBTFUL, RIGHT_DEGREES
from core.fitting.fit import PRESETS, FitJob, FitStep
from core.fitting.paper import fit_as_set
from core.fitting.settings import FitSettings
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.lab.benchmarks.held_out_views import HeldOutView, is_symmetric_view, render_on_white
from core.lab.benchmarks.stressors import STRESSORS, Cutout, Stressor
from core.lab.evaluation.statistics import Mean, mean_of
from core.metrics import rotation_error
from core.models.library import load_model, shipped_models
from core.models.model import Instance, Model
from core.photos.photo import prepare_photo
from core.photos.segmentation import cut_out
from core.rendering.surface import surface_points

KEY = "stressor", "level", "preset", "name"  # of a trial
COMPARED = ("normal", "paper")  # presets
SUCCESS_DEGREES = RIGHT_DEGREES
ROUGH_DEGREES = 30.0  # a camera off by less sees the right side


@dataclass(frozen=True)
class RobustnessTrial:
    """A fit of one corrupted image."""

    stressor: str
    level: float
    preset: str
    name: str  # of the object
    rotation: float | None = None
    """degrees, error; 0 if the object looks the same; None if the image was refused or shows no object"""
    confidence: float | None = None
    size_error: float | None = None  # of the fitted object's longest side, relative to the true one
    outcome: str = ""
    """"correct", "symmetric", "near", "opposite", "wrong", or why the image was refused; of images without an object
    "refused", "doubted" or "believed"."""


Rates = dict[tuple[str, float, str], Mean]  # 0..1, by stressor, level and preset


def successes(trials: pd.DataFrame) -> pd.Series:
    """Mark cameras within 10 degrees or right by symmetry, and images without an object, refused or doubted."""
    return trials.outcome.isin(("correct", "symmetric", "refused", "doubted"))


def success_rates(trials: pd.DataFrame) -> Rates:
    """Return the fractions of successes."""
    return _rates(trials, successes(trials))


def rough_rates(trials: pd.DataFrame) -> Rates:
    """Return the fractions of cameras within 30 degrees; a success without an object counts as one."""
    return _rates(trials, successes(trials) | (trials.rotation <= ROUGH_DEGREES))


def _rates(trials: pd.DataFrame, counted: pd.Series) -> Rates:
    groups = counted.groupby([trials[name] for name in KEY[:3]], sort=False)
    return {key: mean_of(group) for key, group in groups}


def measure_robustness(
    model: Model,
    views: Sequence[HeldOutView],
    stressors: Sequence[str] = (),
    presets: Sequence[str] = COMPARED,
    seed: int = 0,
    done: Collection[tuple[str, float, str, str]] = (),
) -> Iterator[RobustnessTrial]:
    """Fit every corrupted image and yield each trial.

    Args:
        stressors: names; all of them if empty.
        done: keys of trials to leave out.

    Raise ``ValueError`` if there is no such stressor or preset.
    """
    for name in (*stressors, *presets):
        if name not in STRESSORS and name not in PRESETS:
            raise ValueError(f"there is no {name!r}; there are {', '.join((*STRESSORS, *PRESETS))}")
    keys = [
        (name, level, preset, number)
        for number in range(len(views))
        for name in stressors or STRESSORS
        for level in STRESSORS[name].levels
        for preset in presets
    ]
    for name, level, preset, number in keys:
        trial = RobustnessTrial(name, level, preset, views[number].views.name)
        stressor = STRESSORS[name]
        if (name, level, preset, trial.name) in done:
            continue
        subject = _subject(views[number], stressor.camera(views[number].camera, level))
        image = _corrupted(model, subject, stressor, level, seed + number)
        yield _fit(model, _Attempt(image, subject, PRESETS[preset], seed + number, stressor), trial)


class _Subject(NamedTuple):
    """An object from its true camera."""

    cutout: Cutout
    camera: Camera
    view: HeldOutView


def _subject(view: HeldOutView, camera: Camera) -> _Subject:
    """Return the object from a camera: the image taken from there or close by, else a render of its codes."""
    index = view.nearest(camera)
    if index is None:
        return _Subject(_cutout(*map(np.asarray, render_on_white(view.instance, camera))), camera, view)
    image = view.views.images[index].astype(np.float32) / 255
    return _Subject(_cutout(image, view.views.masks[index]), view.views.cameras[index], view)


def _cutout(image: np.ndarray, mask: np.ndarray) -> Cutout:
    return np.concatenate((image, mask[..., None]), -1).astype(np.float32)


def _corrupted(model: Model, subject: _Subject, stressor: Stressor, level: float, seed: int) -> np.ndarray:
    cutout = subject.cutout
    if stressor.other_category:
        other_model = load_model(next(name for name in shipped_models() if name != model.category), model.device.type)
        camera = other_model.camera(subject.camera.azimuth, subject.camera.elevation)
        instance = other_model[seed % len(other_model.codes.objects)]
        cutout = _cutout(*map(np.asarray, render_on_white(instance, camera)))
    return stressor.corrupt(cutout, level, np.random.default_rng(seed))


class _Attempt(NamedTuple):
    """A corrupted image, its truth, and the settings of its fit."""

    image: np.ndarray
    subject: _Subject
    settings: FitSettings
    seed: int
    stressor: Stressor

    def job(self, model: Model) -> FitJob:
        """Return the fit."""
        cut = cut_out(Image.fromarray(to_bytes(self.image)).convert("RGBA"))
        return FitJob((prepare_photo(cut, model),), self.settings, self.seed)


def _fit(model: Model, attempt: _Attempt, trial: RobustnessTrial) -> RobustnessTrial:
    """Return the trial with its outcome."""
    try:
        *_, last = fit_as_set(model, attempt.job(model))
    except ValueError as error:
        return replace(trial, outcome="refused" if attempt.stressor.other_category else str(error))
    return _judge(model, attempt, last, replace(trial, confidence=last.confidence))


def _judge(model: Model, attempt: _Attempt, last: FitStep, trial: RobustnessTrial) -> RobustnessTrial:
    if attempt.stressor.other_category:
        doubted = last.confidence is not None and last.confidence < DOUBTFUL
        return replace(trial, outcome="doubted" if doubted else "believed")
    camera = last.cameras[0]
    truth = attempt.subject.camera
    instance = attempt.subject.view.instance
    rotation = rotation_error(camera, truth)
    outcome = name_camera(camera, truth)
    if outcome in ("opposite", "wrong") and is_symmetric_view(instance, camera, truth, SUCCESS_DEGREES):
        rotation, outcome = 0.0, "symmetric"
    size = _longest_side(last.instance) / _longest_side(instance) - 1
    return replace(trial, rotation=rotation, size_error=size, outcome=outcome)


def _longest_side(instance: Instance) -> float:
    """Return the length in scene units; NaN if the object is empty."""
    points, _ = surface_points(instance)
    return float((points.amax(0) - points.amin(0)).max()) if len(points) else math.nan


def name_camera(fitted: Camera, truth: Camera) -> str:
    """Classify a fitted camera as "correct", "near", "opposite" (180 degrees around) or "wrong"."""
    rotation = rotation_error(fitted, truth)
    if rotation <= SUCCESS_DEGREES:
        return "correct"
    if rotation <= ROUGH_DEGREES:
        return "near"
    turn = math.degrees(fitted.azimuth - truth.azimuth) % 360
    tilt = abs(math.degrees(fitted.elevation - truth.elevation))
    return "opposite" if abs(turn - 180) < ROUGH_DEGREES and tilt < ROUGH_DEGREES else "wrong"
