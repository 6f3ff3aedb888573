"""Failures of fits: input that is wrong in one way at a time, and the confidence that the program states.

A corrupted image enters a fit as a user's photo does: it is cut out by its alpha channel and cropped.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from PIL import Image

from core.fitting.confidence import DOUBTFUL, RIGHT_DEGREES
from core.fitting.fit import PRESETS, FitJob
from core.fitting.paper import fit_as_set
from core.geometry.pixels import to_bytes
from core.lab.benchmarks.fits import DEFAULT
from core.lab.benchmarks.held_out_views import SCORED_VIEWS, HeldOutView, Trial
from core.lab.benchmarks.stressors import STRESSORS, Cutout, Stressor
from core.lab.datasets.srn import ObjectViews
from core.photos.photo import Photo, prepare_photo
from core.photos.segmentation import cut_out


@dataclass(frozen=True)
class StabilityTrial(Trial):
    """A fit of corrupted input."""

    stressor: str
    level: float
    method: str
    n: int = SCORED_VIEWS  # other views that score the fit
    rotation: float | None = None  # degrees, mean over the object's photos; None if nothing was fitted
    right: bool = False  # cameras within 10 degrees; of a stranger: refused or doubted
    novel: float | None = None  # dB, of other views
    confidence: float | None = None
    doubted: bool = False  # refused, or of a confidence below one half
    outcome: str = ""  # reason of a refusal


def cases(quick: bool) -> tuple[str, ...]:
    """Return the names of the cases: every level by the default (quick: the last), the last by the paper's recipe."""
    return tuple(
        f"{name} {level:g}, {method}"
        for name, stressor in STRESSORS.items()
        for level in (stressor.levels[-1:] if quick else stressor.levels)
        for method in (DEFAULT, "paper")
        if method == DEFAULT or not (quick or level != stressor.levels[-1] or stressor.stranger or stressor.intruders)
    )


def measure(view: HeldOutView, case: str) -> tuple[StabilityTrial, ...]:
    """Fit the corrupted photo of a view by a method; return nothing without the other object that a case needs."""
    words, method = case.split(", ")
    name, level = words.split()
    stressor = STRESSORS[name]
    trial = StabilityTrial(*view.key(case), name, float(level), method)
    if (stressor.stranger and not view.stranger) or (stressor.intruders and not view.partner):
        return ()
    try:
        photos = corrupted_photos(view, stressor, trial.level)
        *_, last = fit_as_set(view.model, FitJob(photos, PRESETS[method], view.seed))
    except ValueError as error:
        return (replace(trial, doubted=True, right=stressor.stranger, outcome=f"refused: {error}"),)
    doubted = last.confidence is not None and last.confidence < DOUBTFUL
    trial = replace(trial, confidence=last.confidence, doubted=doubted, right=doubted)
    if not stressor.stranger:
        truth = view.cameras(len(last.cameras) - stressor.intruders)
        errors = [view.camera_error(*pair) for pair in zip(last.cameras, truth, strict=False)]
        right = max(errors) <= RIGHT_DEGREES
        trial = replace(trial, rotation=float(np.mean(errors)), right=right, novel=view.score(last.instance).psnr)
    return (trial,)


def corrupted_photos(view: HeldOutView, stressor: Stressor, level: float) -> tuple[Photo, ...]:
    """Return the photos of a fit. Raises ``ValueError`` if nothing of the object is left."""
    index = view.order[0]
    if stressor.intruders:
        assert view.partner
        return *view.photos(3 - stressor.intruders, False), _photo(view, _cutout(view.partner, view.order[2]))
    views = view.stranger if stressor.stranger else view.views
    assert views
    generator = np.random.default_rng(view.seed)
    corrupted = stressor.corrupt(_cutout(views, index), level, generator)
    return (_photo(view, corrupted, level * views.cameras[index].focal if stressor.focal else None),)


def _cutout(views: ObjectViews, index: int) -> Cutout:
    index %= len(views.cameras)
    image = views.images[index].astype(np.float32) / 255
    return np.concatenate((image, views.masks[index][..., None]), -1).astype(np.float32)


def _photo(view: HeldOutView, cutout: Cutout, focal: float | None = None) -> Photo:
    cut = cut_out(Image.fromarray(to_bytes(cutout)).convert("RGBA"))
    return prepare_photo(replace(cut, focal=focal), view.model)


def wrong_and_sure(trials: pd.DataFrame, threshold: float) -> pd.Series:
    """Mark wrong results whose confidence reaches a threshold."""
    return ~trials.right & (trials.confidence.fillna(0.0) >= threshold)


def surest_mistakes(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the wrong fit of a photo by the default with the highest confidence, of each category that has one."""
    wrong = trials[~trials.right & (trials.method == DEFAULT) & trials.rotation.notna()]
    return wrong.sort_values("confidence", ascending=False).drop_duplicates("category")
