"""The paper's protocol: fit an object on one view or a few, draw its other views, compare."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from core.datasets.srn import ObjectViews
from core.fitting.fit import PRESETS, FitJob, FitStep, fit
from core.geometry.camera import Camera
from core.metrics import psnr, rotation_error, ssim, translation_error
from core.models.codes import Codes
from core.models.model import Model
from core.photos.photo import Photo
from core.rendering.fast import render
from core.rendering.progressive import RenderSettings
from core.rendering.reference import render_exact

OUTLIER_DEGREES, OUTLIER_SHARE = 5.0, 0.03
"""A camera that is further off than this, in either, counts as not found."""
_EXACT_SAMPLES = 64
_RESAMPLES = 2000


@dataclass(frozen=True)
class Protocol:
    """How an object is shown to the model."""

    inputs: tuple[int, ...] = (64,)
    """the views that are fitted; the others are drawn"""
    estimate: bool = False
    """find the inputs' cameras instead of taking the true ones"""
    preset: str = "normal"
    """of :data:`core.fitting.fit.PRESETS`"""
    seed: int = 0
    every: int = 1
    """draw only each such view of the others; all of them in the paper"""

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise ValueError(f"no fit has this preset: {self.preset}")
        if not self.inputs or min(self.inputs) < 0 or len(set(self.inputs)) < len(self.inputs):
            raise ValueError(f"inputs are different views counted from 0, got {self.inputs}")
        if self.every < 1:
            raise ValueError(f"at least one view in a row is drawn, got every {self.every}")


@dataclass(frozen=True)
class PoseScore:
    """How far a found camera is from the true one, at the end of the fit and after its first step."""

    view: int
    rotation: float
    """degrees"""
    translation: float
    """share of the true distance"""
    first_rotation: float
    first_translation: float

    @property
    def outlier(self) -> bool:
        """The camera was not found."""
        return self.rotation > OUTLIER_DEGREES or self.translation > OUTLIER_SHARE


@dataclass(frozen=True)
class ObjectScore:
    """One object."""

    name: str
    psnr: float
    """dB, mean over those of its other views that were drawn"""
    ssim: float
    views: int
    """that were drawn"""
    seconds: float
    """that the fit took"""
    poses: tuple[PoseScore, ...] = ()
    """of the inputs, where their cameras were estimated"""

    @property
    def outlier(self) -> bool:
        """One of its cameras was not found."""
        return any(pose.outlier for pose in self.poses)


def evaluate(model: Model, objects: Iterable[ObjectViews], protocol: Protocol) -> Iterator[ObjectScore]:
    """A score per object, in their order. To stop, ask for no more.

    Codes live in the frame of the fitted cameras; the other views are drawn with their true ones all the same, as in
    the paper. Raises ``ValueError`` for an object that has too few views, or no view like the model's.
    """
    for views in objects:
        yield _scored(model, views, protocol)


def _scored(model: Model, views: ObjectViews, protocol: Protocol) -> ObjectScore:
    rest = [index for index in range(len(views.cameras)) if index not in protocol.inputs][:: protocol.every]
    if max(protocol.inputs) >= len(views.cameras) or not rest:
        raise ValueError(f"{views.name}: {len(views.cameras)} views, and the inputs are {protocol.inputs}")
    if protocol.estimate:
        _require_lens(model, views)
    photos = tuple(photo(views, index, not protocol.estimate) for index in protocol.inputs)
    job = FitJob(photos, PRESETS[protocol.preset], protocol.seed)
    first, last = fitted(model, job)
    scores = [compared(model, last.codes, views, index) for index in rest]
    poses = tuple(
        _pose_score(view, views.cameras[view], found, start)
        for view, found, start in zip(protocol.inputs, last.cameras, first.cameras, strict=True)
        if protocol.estimate
    )
    means = np.mean(scores, axis=0)
    return ObjectScore(views.name, float(means[0]), float(means[1]), len(rest), last.seconds, poses)


def fitted(model: Model, job: FitJob) -> tuple[FitStep, FitStep]:
    """The first and the last step of a fit."""
    steps = fit(model, job)
    first = last = next(steps)
    for step in steps:
        last = step
    return first, last


def photo(views: ObjectViews, index: int, posed: bool) -> Photo:
    """A view as a picture to fit, with its camera where that is given away."""
    pixels = torch.from_numpy(views.images[index]).float() / 255
    return Photo(pixels, torch.from_numpy(views.masks[index]), views.cameras[index] if posed else None)


def compared(model: Model, codes: Codes, views: ObjectViews, index: int) -> tuple[float, float]:
    """PSNR (dB) and SSIM of a drawn view, clipped to [0, 1], against the true one."""
    drawn = drawn_view(model, codes, views.cameras[index])
    truth = torch.from_numpy(views.images[index]).float() / 255
    return psnr(drawn, truth), ssim(drawn, truth)


def drawn_view(model: Model, codes: Codes, camera: Camera) -> Float[Tensor, "height width 3"]:
    """A view as the model shows it, in [0, 1]: marched, or exactly, with the authors' samples, where it is their file
    or an entangled design.
    """
    if model.white_from_network or model.is_ablation:
        return render_exact(model, codes, camera, _EXACT_SAMPLES).colour.clamp(0, 1).cpu()
    return render(model, codes, camera, RenderSettings().samples).colour.clamp(0, 1).cpu()


def _require_lens(model: Model, views: ObjectViews) -> None:
    camera = views.cameras[0]
    theirs, ours = camera.focal / camera.height, model.focal / model.image_size
    if abs(theirs - ours) > 0.01 * ours:
        raise ValueError(f"{views.name}: focal length {theirs:.3f} of the height, and the model knows {ours:.3f} only")


def _pose_score(view: int, truth: Camera, found: Camera, start: Camera) -> PoseScore:
    errors = [measure(camera, truth) for camera in (found, start) for measure in (rotation_error, translation_error)]
    return PoseScore(view, *errors)


# Averages


class Mean(NamedTuple):
    """A mean over objects, and the interval that holds it with 95 % (bootstrap over objects)."""

    mean: float
    low: float
    high: float


def mean_of(values: Sequence[float]) -> Mean:
    """The mean and its bootstrap interval, the same one every time. NaN where there are no values.

    Example:
        >>> mean_of([2.0, 2.0])
        Mean(mean=2.0, low=2.0, high=2.0)
    """
    if not len(values):
        return Mean(float("nan"), float("nan"), float("nan"))
    known = np.asarray(values, np.float64)
    drawn = np.random.default_rng(0).integers(0, len(known), (_RESAMPLES, len(known)))
    low, high = np.percentile(known[drawn].mean(1), (2.5, 97.5))
    return Mean(float(known.mean()), float(low), float(high))


@dataclass(frozen=True)
class PoseSummary:
    """Errors of estimated cameras, averaged per object and over objects."""

    cameras: int
    rotation: Mean
    """degrees"""
    translation: Mean
    """share of the true distance"""
    first_rotation: Mean
    first_translation: Mean
    within_5_degrees: Mean
    """shares of cameras, 0..1"""
    within_10_degrees: Mean
    within_3_percent: Mean
    within_5_percent: Mean


@dataclass(frozen=True)
class Summary:
    """A line of the paper's table."""

    objects: int
    psnr: Mean
    ssim: Mean
    seconds: Mean
    pose: PoseSummary | None
    """None where cameras were known"""
    without_outliers: "Summary | None" = None


def summarised(scores: Sequence[ObjectScore]) -> Summary:
    """All objects, and where cameras were estimated the same without the objects whose camera was not found."""
    whole = _summary(scores)
    if whole.pose is None:
        return whole
    return replace(whole, without_outliers=_summary([score for score in scores if not score.outlier]))


def _summary(scores: Sequence[ObjectScore]) -> Summary:
    ratio, alike, seconds = (mean_of([getattr(one, name) for one in scores]) for name in ("psnr", "ssim", "seconds"))
    posed = [score for score in scores if score.poses]
    return Summary(len(scores), ratio, alike, seconds, _pose_summary(posed) if posed else None)


def _pose_summary(scores: Sequence[ObjectScore]) -> PoseSummary:
    def over(measure: str) -> Mean:
        return mean_of([float(np.mean([getattr(pose, measure) for pose in score.poses])) for score in scores])

    def within(measure: str, most: float) -> Mean:
        return mean_of([float(np.mean([getattr(p, measure) <= most for p in score.poses])) for score in scores])

    return PoseSummary(
        sum(len(score.poses) for score in scores),
        *(over(name) for name in ("rotation", "translation", "first_rotation", "first_translation")),
        *(within("rotation", degrees) for degrees in (5.0, 10.0)),
        *(within("translation", share) for share in (0.03, 0.05)),
    )
