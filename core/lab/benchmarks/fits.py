"""Fits of views by several methods: speed against accuracy, freedom, and the worth of each component.

A case is a method with a number of photos, whose cameras are known or not. All cases of a view are fitted one after the
other, as views differ far more than methods, and scored by the same other views.
"""

import math
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch

from core.fitting.confidence import RIGHT_DEGREES
from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep
from core.fitting.network import MIN_PHOTOS
from core.fitting.paper import fit_as_set
from core.fitting.settings import ALL_COMPONENTS, Components
from core.lab.benchmarks.held_out_views import SCORED_VIEWS, HeldOutView, Trial
from core.lab.evaluation.protocol import ViewScore
from core.models.codes import CodeSpace
from core.models.model import Model
from core.runtime.precision import use_dtype


class FitCase(NamedTuple):
    """One way to fit a number of photos."""

    settings: FitSettings
    photos: int = 1
    posed: bool = False  # with the true cameras
    directions: int | None = None  # at most, of shape codes and of texture codes; None: all
    components: Components = ALL_COMPONENTS
    dtype: torch.dtype | None = None  # of multiplications; None: the machine's


@dataclass(frozen=True)
class FitTrial(Trial):
    """A fit of one case and its errors."""

    photos: int
    posed: bool
    free: int  # numbers that the fit may choose for the object
    n: int  # other views that score the fit
    seconds: float  # processor time of one thread; wall-clock time on a graphics card
    rotation: float  # degrees, mean error of the cameras; 0 for one that is right by symmetry
    right: float  # fraction of the cameras within 10 degrees, or right by symmetry
    photo: float  # dB, of the fitted photos
    novel: ViewScore  # mean over other views, from their true cameras
    restarted: bool  # the camera was in doubt after the first search
    confidence: float | None
    margin: float | None  # as in FitStep, like the uncertainty
    uncertainty: float | None  # degrees


_USUAL = PRESETS["normal"]
_CODES = replace(_USUAL, free_steps=0)
DEFAULT = "normal"
SPEED = {
    **{name: FitCase(settings) for name, settings in PRESETS.items()},
    "codes alone": FitCase(_CODES),
    **{f"{count} photos": FitCase(_USUAL, count) for count in (2, 3, 5)},
}  # speed against accuracy; the cameras are unknown
_CODE_LEVELS = {"mean object": 0, "8 + 8": 8, "16 + 16": 16, "32 + 32": 32, "all codes": None}
"""directions of shape and texture codes"""
_BIASES = replace(ALL_COMPONENTS, network=False)
PHOTO_COUNTS = 1, 2, 3, 5
FREEDOM = {
    **{
        f"{level}, {count}": FitCase(_CODES, count, True, directions)
        for level, directions in _CODE_LEVELS.items()
        for count in PHOTO_COUNTS
    },
    **{f"biases, {count}": FitCase(_USUAL, count, True, components=_BIASES) for count in PHOTO_COUNTS},
    **{f"network, {count}": FitCase(_USUAL, count, True) for count in PHOTO_COUNTS[2:]},
}  # the worth of more freedom; the cameras are known
LEVELS = *_CODE_LEVELS, "biases", "network"
PAPER = {f"paper, {count} posed": FitCase(PRESETS["paper"], count, True) for count in (1, 2)}
"""The paper's recipe with the paper's one and two views."""
WITHOUT = {
    "without view bank": FitCase(_USUAL, components=Components(view_bank=False)),
    "without viewpoint classifier": FitCase(_USUAL, components=Components(viewpoint_classifier=False)),
    "without prototype shapes": FitCase(_USUAL, components=Components(prototype_shapes=False)),
    "without fresh codes": FitCase(_USUAL, components=Components(fresh_codes=False)),
    "without multi-start": FitCase(replace(_USUAL, hypotheses=1, max_restarts=0)),
    "without restart": FitCase(replace(_USUAL, max_restarts=0)),
    "without code prior": FitCase(replace(_USUAL, code_prior=0.0)),
    "without camera prior": FitCase(_USUAL, components=Components(camera_prior=False)),
    "without robust loss": FitCase(_USUAL, components=Components(robust_loss=False)),
    "without mask loss": FitCase(_USUAL, components=Components(mask_loss=False)),
    "without bfloat16": FitCase(_USUAL, dtype=torch.float32),
}  # each leaves one component of the default out
CASES = SPEED | FREEDOM | PAPER | WITHOUT


def cases(quick: bool) -> tuple[str, ...]:
    """Return the names of the cases to measure; quick ones are of one photo or three, and leave no component out."""
    names = (name for name, case in CASES.items() if case.photos in (1, 3) and name != "fine" and name not in WITHOUT)
    return tuple(names if quick else CASES)


def measure(view: HeldOutView, name: str) -> tuple[FitTrial]:
    """Fit the photos of a view by a case and compare with the truth."""
    case = CASES[name]
    model = view.model if case.directions is None else with_directions(view.model, case.directions)
    job = FitJob(view.photos(case.photos, case.posed), case.settings, view.seed, components=case.components)
    clock = time.perf_counter if model.device.type == "cuda" else time.process_time
    began = clock()
    last: FitStep | None = None
    restarted = False
    if case.directions != 0:
        with use_dtype(case.dtype) if case.dtype else nullcontext():
            for last in fit_as_set(model, job):
                restarted |= last.restart
    seconds = clock() - began
    truth = view.cameras(case.photos)
    errors = [view.camera_error(*pair) for pair in zip(last.cameras if last else truth, truth, strict=True)]
    trial = FitTrial(
        *view.key(name),
        case.photos,
        case.posed,
        free=free_numbers(model, case),
        n=SCORED_VIEWS,
        seconds=seconds,
        rotation=float(np.mean(errors)),
        right=float(np.mean([error <= RIGHT_DEGREES for error in errors])),
        photo=last.psnr if last else math.nan,
        novel=view.score(last.instance if last else model.mean),
        restarted=restarted,
        confidence=last.confidence if last else None,
        margin=last.margin if last else None,
        uncertainty=last.uncertainty if last else None,
    )
    return (trial,)


def free_numbers(model: Model, case: FitCase) -> int:
    """Return how many numbers of an object a case may choose, where photos show all of its sides."""
    if case.settings.free_steps and not model.white_from_network:
        biases = sum(std.numel() for std in model.bias_std)
        frees_all = case.components.network and case.photos >= MIN_PHOTOS
        weights = *model.field.shape_weights, *model.field.texture_weights
        return biases + frees_all * sum(weight.numel() for weight in weights)
    return sum(len(space.std) for space in (model.codes.shape_space, model.codes.texture_space))


def with_directions(model: Model, directions: int) -> Model:
    """Return a model whose objects differ along the leading directions of its codes only."""
    book = replace(model.codes)
    for name in ("shape_space", "texture_space"):
        space: CodeSpace = getattr(model.codes, name)
        leading = CodeSpace(space.mean, space.directions[:directions], space.std[:directions])
        vars(book)[name] = leading  # the value of the cached property
    return replace(model, codes=book)
