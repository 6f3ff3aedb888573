"""Where fits fail: images corrupted in one way at a time, fitted without their camera.

Training objects, so that nothing but the stressor is wrong with an image. A corrupted image enters a fit as a user's
photo does: it is segmented by its alpha channel, or by its background where there is none.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import UInt8

from core.benchmarks.held_out_views import evenly_spaced_objects, is_symmetric_view, random_camera, render_on_white
from core.benchmarks.machine import describe_machine
from core.benchmarks.stressors import STRESSORS, Stressor
from core.fitting.confidence import DOUBTFUL
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep, Hypothesis, fit
from core.fitting.settings import PaperSettings
from core.geometry.camera import Camera
from core.metrics import rotation_error
from core.models.codes import Codes
from core.models.library import load_model, shipped_models
from core.models.model import Model
from core.photos.photo import photo_from_array

COMPARED = {name: PRESETS[name] for name in ("normal", "paper")}
SUCCESS_DEGREES = 5.0
_BASIN = 25.0
"""degrees: a camera that is off by less is near the true one, or near the opposite view of it"""


@dataclass(frozen=True)
class Trial:
    """One fit of one corrupted image."""

    stressor: str
    level: float
    preset: str
    name: str
    """of the object"""
    rotation: float | None = None
    """degrees, error; None where the image was refused or shows no object of the model"""
    confidence: float | None = None
    outcome: str = ""
    """"correct", "symmetric", "near", "opposite", "wrong", or why the image was refused; where there is no object to be
    found "refused", "doubted" or "believed"."""

    @property
    def success(self) -> bool:
        """The camera is within 5 degrees, or right by symmetry; without an object, the fit was refused or doubted."""
        return self.outcome in ("correct", "symmetric", "refused", "doubted")


class Failure(NamedTuple):
    """A trial without success, with its images."""

    trial: Trial
    image: UInt8[np.ndarray, "height width 3"]
    """the corrupted image"""
    render: UInt8[np.ndarray, "size size 3"] | None
    """of what was fitted; None where the image was refused"""


@dataclass(frozen=True, eq=False)
class RobustnessResults:
    """All trials of one run."""

    machine: str
    objects: int
    trials: tuple[Trial, ...]
    failures: tuple[Failure, ...] = ()

    def success_rates(self) -> dict[tuple[str, float], dict[str, float]]:
        """The share of successes of every preset, 0..1, by stressor and level."""
        found: dict[tuple[str, float], dict[str, list[bool]]] = {}
        for trial in self.trials:
            presets = found.setdefault((trial.stressor, trial.level), {})
            presets.setdefault(trial.preset, []).append(trial.success)
        return {
            key: {preset: sum(successes) / len(successes) for preset, successes in presets.items()}
            for key, presets in found.items()
        }


def run(
    model: Model, objects: int = 2, seed: int = 0, presets: dict[str, FitSettings] = COMPARED
) -> Iterator[str | RobustnessResults]:
    """Yields what is being measured, and at the end the results."""
    generator = torch.Generator().manual_seed(seed)
    views = [(*one, random_camera(model, generator)) for one in evenly_spaced_objects(model, objects)]
    trials, failures = list[Trial](), list[Failure]()
    for name, stressor in STRESSORS.items():
        for level in stressor.levels:
            yield f"{name} {level:g} {stressor.unit}"
            for number, (object_name, codes, camera) in enumerate(views):
                truth = stressor.camera(camera, level)
                image = _corrupted(model, codes, truth, stressor, level, seed + number)
                for preset, settings in presets.items():
                    initial_camera = stressor.init if isinstance(settings, PaperSettings) else None
                    init = initial_camera(truth, level) if initial_camera else None
                    attempt = _Attempt(image, codes, truth, settings, seed + number, init, stressor.no_object)
                    trial, failure = _fit(model, attempt, Trial(name, level, preset, object_name))
                    trials.append(trial)
                    failures += [failure] if failure else []
    yield RobustnessResults(describe_machine(model.device), len(views), tuple(trials), tuple(failures))


def _corrupted(model: Model, codes: Codes, camera: Camera, stressor: Stressor, level: float, seed: int) -> np.ndarray:
    if stressor.other_category:
        model = load_model(next(name for name in shipped_models() if name != model.category), model.device.type)
        codes, camera = model.codes[seed % len(model.codes.objects)], model.camera(camera.azimuth, camera.elevation)
    colour, mask = render_on_white(model, codes, camera)
    cutout = np.concatenate((colour.numpy(), mask[..., None].numpy().astype(np.float32)), -1)
    return stressor.corrupt(cutout, level, np.random.default_rng(seed))


class _Attempt(NamedTuple):
    """A corrupted image, the truth about it, and how it is fitted."""

    image: np.ndarray
    codes: Codes
    truth: Camera
    settings: FitSettings
    seed: int
    init: Camera | None
    no_object: bool

    def job(self, model: Model) -> FitJob:
        """The fit, from the mean codes where there is an initial camera."""
        photo, initial = photo_from_array(self.image, model), None
        if self.init:
            initial = Hypothesis(0, math.inf, (self.init,), model.codes.mean, torch.zeros(1, 4))
        return FitJob((photo,), self.settings, self.seed, initial)


def _fit(model: Model, attempt: _Attempt, trial: Trial) -> tuple[Trial, Failure | None]:
    """The trial with its outcome, and its images where it failed."""
    image = attempt.image[..., :3]
    image = image if image.dtype == np.uint8 else (255 * image + 0.5).astype(np.uint8)
    try:
        *_, last = fit(model, attempt.job(model))
    except ValueError as error:
        trial = replace(trial, outcome="refused" if attempt.no_object else str(error))
        return trial, None if trial.success else Failure(trial, image, None)
    rotation = None if attempt.no_object else rotation_error(last.cameras[0], attempt.truth)
    trial = replace(trial, rotation=rotation, confidence=last.confidence, outcome=_outcome(model, attempt, last))
    if trial.success:
        return trial, None
    render = render_on_white(model, last.codes, last.cameras[0])[0]
    return trial, Failure(trial, image, (255 * render + 0.5).byte().numpy())


def _outcome(model: Model, attempt: _Attempt, last: FitStep) -> str:
    if attempt.no_object:
        return "doubted" if last.confidence is not None and last.confidence < DOUBTFUL else "believed"
    camera, truth = last.cameras[0], attempt.truth
    name = name_camera(camera, truth)
    far = name in ("opposite", "wrong")
    return "symmetric" if far and is_symmetric_view(model, attempt.codes, camera, truth, SUCCESS_DEGREES) else name


def name_camera(found: Camera, truth: Camera) -> str:
    """Where a fitted camera ended: "correct", "near", "opposite" (180 degrees around) or "wrong"."""
    rotation = rotation_error(found, truth)
    if rotation <= SUCCESS_DEGREES:
        return "correct"
    if rotation <= _BASIN:
        return "near"
    turn = math.degrees(found.azimuth - truth.azimuth) % 360
    tilt = abs(math.degrees(found.elevation - truth.elevation))
    return "opposite" if abs(turn - 180) < _BASIN and tilt < _BASIN else "wrong"
