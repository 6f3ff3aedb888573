"""The paper's protocol: fit an object to one or a few views, render its other views, compare.

The scores become means over objects with bootstrap intervals, tables as text, and JSON.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from core.fitting.fit import PRESETS, FitJob, FitStep
from core.fitting.paper import fit_as_set
from core.geometry.camera import Camera
from core.lab.datasets.srn import ObjectViews
from core.metrics import haze, psnr, rotation_error, silhouette_overlap, ssim, translation_error
from core.models.model import Instance, Model
from core.photos.photo import Photo
from core.rendering.images import render_image
from core.runtime.files import write_json

_RESAMPLES = 2000  # of the bootstrap


@dataclass(frozen=True)
class EvaluationProtocol:
    """Choice of fitted and rendered views."""

    inputs: tuple[int, ...] = (64,)  # fitted views; the others are rendered and compared
    estimate: bool = False  # estimate the cameras of the input views instead of using the true ones
    preset: str = "normal"  # of PRESETS
    seed: int = 0
    every: int = 1  # stride over the other views; the paper renders all of them

    def __post_init__(self) -> None:
        if not self.inputs or min(self.inputs) < 0 or len(set(self.inputs)) < len(self.inputs):
            raise ValueError(f"input views must be distinct numbers from 0, got {self.inputs}")


@dataclass(frozen=True)
class PoseScore:
    """Errors of an estimated camera, at the end of the fit and after its first step."""

    view: int
    rotation: float  # degrees
    translation: float  # fraction of the true distance
    initial_rotation: float
    initial_translation: float

    @property
    def outlier(self) -> bool:
        """True if the camera is off by more than 5 degrees or 3 % of the distance."""
        return self.rotation > 5.0 or self.translation > 0.03


@dataclass(frozen=True)
class ObjectScore:
    """Reconstruction quality of one object."""

    name: str
    psnr: float  # dB, mean over the rendered views
    ssim: float
    views: int  # number of rendered views
    seconds: float  # of the fit
    poses: tuple[PoseScore, ...] = ()  # one per input view, for estimated cameras

    @property
    def outlier(self) -> bool:
        """True if one of its cameras is an outlier."""
        return any(pose.outlier for pose in self.poses)


def evaluate(model: Model, objects: Iterable[ObjectViews], protocol: EvaluationProtocol) -> Iterator[ObjectScore]:
    """Yield a score per object, in order.

    Codes are relative to the fitted cameras, yet the other views are rendered from their true cameras, as in the paper.
    Raises ``ValueError`` for an object with too few views or, when estimating cameras, another focal length than the
    model's.
    """
    for views in objects:
        rest = [index for index in range(len(views.cameras)) if index not in protocol.inputs][:: protocol.every]
        _check(model, views, protocol, rest)
        photos = tuple(as_photo(views, index, not protocol.estimate) for index in protocol.inputs)
        first, last = fit_first_last(model, FitJob(photos, PRESETS[protocol.preset], protocol.seed))
        means = np.mean([score_view(last.instance, views, index) for index in rest], axis=0)
        poses = tuple(
            _pose_score(view, views.cameras[view], estimated, initial)
            for view, estimated, initial in zip(protocol.inputs, last.cameras, first.cameras, strict=True)
            if protocol.estimate
        )
        yield ObjectScore(views.name, float(means[0]), float(means[1]), len(rest), last.seconds, poses)


def fit_first_last(model: Model, job: FitJob) -> tuple[FitStep, FitStep]:
    """Run a fit and return its first and its last step."""
    steps = fit_as_set(model, job)
    first = last = next(steps)
    for step in steps:
        last = step
    return first, last


def as_photo(views: ObjectViews, index: int, posed: bool) -> Photo:
    """Return a view as a photo to fit; ``posed``: with its true camera."""
    pixels = torch.from_numpy(views.images[index]).float() / 255
    return Photo(pixels, torch.from_numpy(views.masks[index]), views.cameras[index] if posed else None)


class ViewScore(NamedTuple):
    """A rendered view against the true image and its mask."""

    psnr: float  # dB
    ssim: float
    overlap: float  # of the silhouettes: intersection over union
    haze: float


def score_view(instance: Instance, views: ObjectViews, index: int) -> ViewScore:
    """Compare a rendered view, its colours clipped to [0, 1], with the true one."""
    rendered = render_image(instance, views.cameras[index])
    colour = rendered.colour.clamp(0, 1).cpu()
    opacity = rendered.opacity.cpu().numpy()
    truth = torch.from_numpy(views.images[index]).float() / 255
    overlap = silhouette_overlap(opacity, views.masks[index])
    return ViewScore(psnr(colour, truth), ssim(colour, truth), overlap, haze(opacity))


def _check(model: Model, views: ObjectViews, protocol: EvaluationProtocol, rest: Sequence[int]) -> None:
    count = len(views.cameras)
    inputs = ",".join(map(str, protocol.inputs))
    if max(protocol.inputs) >= count:
        raise ValueError(f"{views.name}: {count} views, 0 to {count - 1}, but the input views are {inputs}")
    if not rest:
        raise ValueError(f"{views.name}: {count} views, all used as input ({inputs}): none left to compare")
    dataset_focal = views.cameras[0].focal / views.cameras[0].height
    model_focal = model.focal / model.image_size
    if protocol.estimate and abs(dataset_focal - model_focal) > 0.01 * model_focal:
        lengths = f"focal length {dataset_focal:.3f} image heights, but the model's is {model_focal:.3f}"
        raise ValueError(f"{views.name}: {lengths}")


def _pose_score(view: int, truth: Camera, estimated: Camera, initial: Camera) -> PoseScore:
    measures = rotation_error, translation_error
    return PoseScore(view, *(measure(camera, truth) for camera in (estimated, initial) for measure in measures))


# Averages


class Mean(NamedTuple):
    """A mean over objects with its 95 % interval (bootstrap over objects)."""

    mean: float
    low: float
    high: float


def mean_of(values: Collection[float]) -> Mean:
    """Return the mean and its deterministic bootstrap interval; NaN without values.

    Example:
        >>> mean_of([2.0, 2.0])
        Mean(mean=2.0, low=2.0, high=2.0)
    """
    if not len(values):
        return Mean(float("nan"), float("nan"), float("nan"))
    array = np.asarray(values, np.float64)
    resamples = np.random.default_rng(0).integers(0, len(array), (_RESAMPLES, len(array)))
    low, high = np.percentile(array[resamples].mean(1), (2.5, 97.5))
    return Mean(float(array.mean()), float(low), float(high))


def format_difference(difference: Mean) -> str:
    """Format a paired difference with its sign and its interval.

    Example:
        >>> format_difference(Mean(-1.0, -1.25, 0.0))
        '-1.00 (-1.25 to +0.00)'
    """
    return f"{difference.mean:+.2f} ({difference.low:+.2f} to {difference.high:+.2f})"


@dataclass(frozen=True)
class PoseSummary:
    """Errors of estimated cameras, averaged per object, then over objects."""

    cameras: int
    rotation: Mean  # degrees
    translation: Mean  # fraction of the true distance
    initial_rotation: Mean
    initial_translation: Mean
    within_5_degrees: Mean  # fractions of cameras, 0..1
    within_10_degrees: Mean
    within_3_percent: Mean
    within_5_percent: Mean


@dataclass(frozen=True)
class EvaluationSummary:
    """One line of the paper's table."""

    objects: int
    psnr: Mean
    ssim: Mean
    seconds: Mean
    pose: PoseSummary | None  # None for known cameras
    without_outliers: "EvaluationSummary | None" = None


def summarise(scores: Sequence[ObjectScore]) -> EvaluationSummary:
    """Average over all objects and, for estimated cameras, over the objects without outliers."""
    summary = _summary(scores)
    if summary.pose is None:
        return summary
    return replace(summary, without_outliers=_summary([score for score in scores if not score.outlier]))


def _summary(scores: Sequence[ObjectScore]) -> EvaluationSummary:
    psnr, ssim, seconds = (mean_of([getattr(score, name) for score in scores]) for name in ("psnr", "ssim", "seconds"))
    posed = [score for score in scores if score.poses]
    return EvaluationSummary(len(scores), psnr, ssim, seconds, _pose_summary(posed) if posed else None)


def _pose_summary(scores: Sequence[ObjectScore]) -> PoseSummary:
    def average(measure: str) -> Mean:
        return mean_of([float(np.mean([getattr(pose, measure) for pose in score.poses])) for score in scores])

    def fraction(measure: str, limit: float) -> Mean:
        return mean_of([float(np.mean([getattr(pose, measure) <= limit for pose in score.poses])) for score in scores])

    return PoseSummary(
        sum(len(score.poses) for score in scores),
        *(average(name) for name in ("rotation", "translation", "initial_rotation", "initial_translation")),
        *(fraction("rotation", limit) for limit in (5.0, 10.0)),
        *(fraction("translation", limit) for limit in (0.03, 0.05)),
    )


# Reports


def format_table(scores: Sequence[ObjectScore], protocol: EvaluationProtocol) -> str:
    """Format the paper's table and, for estimated cameras, their errors."""
    summary = summarise(scores)
    inputs = f"{len(protocol.inputs)}-view ({', '.join(map(str, protocol.inputs))})"
    name = f"{inputs}, camera {'estimated' if protocol.estimate else 'known'}"
    lines = [f"{'':38}{'PSNR (dB)':>22}{'SSIM':>24}{'objects':>9}", _row(name, summary)]
    if summary.without_outliers:
        lines.append(_row("  - outliers (over 5 degrees or 3 %)", summary.without_outliers))
    lines.append(f"\n{summary.seconds.mean:.1f} s for a fit; 95 % intervals by bootstrap over objects")
    if summary.pose:
        lines += ["", *_pose_table(summary.pose, summary.without_outliers)]
    return "\n".join(lines)


def write_report(
    path: Path, scores: Sequence[ObjectScore], protocol: EvaluationProtocol, origin: dict[str, str]
) -> None:
    """Write the numbers as JSON, per object too."""
    objects = [asdict(score) | {"outlier": score.outlier} for score in scores]
    content = origin | {"protocol": asdict(protocol), "summary": asdict(summarise(scores)), "objects": objects}
    write_json(path, content)


def _row(name: str, summary: EvaluationSummary) -> str:
    return f"{name:38}{_interval(summary.psnr, 2):>22}{_interval(summary.ssim, 3):>24}{summary.objects:>9}"


def _interval(value: Mean, digits: int, scale: float = 1.0) -> str:
    if math.isnan(value.mean):
        return "-"
    mean, low, high = (f"{scale * number:.{digits}f}" for number in value)
    return f"{mean} [{low}, {high}]"


def _pose_table(pose: PoseSummary, kept: EvaluationSummary | None) -> list[str]:
    without = kept.pose if kept and kept.pose else None
    head = f"{pose.cameras} cameras"
    lines = [f"{head:22}{'initial':>24}{'final':>24}{'- outliers':>24}"]
    rows = (("rotation (degrees)", "rotation", 1.0), ("translation (%)", "translation", 100.0))
    for name, field, scale in rows:
        means = [getattr(pose, f"initial_{field}"), getattr(pose, field), getattr(without, field) if without else None]
        cells = (_interval(mean, 2, scale) if mean else "-" for mean in means)
        lines.append(f"{name:22}" + "".join(f"{cell:>24}" for cell in cells))
    limits = (("5 degrees", "within_5_degrees"), ("10 degrees", "within_10_degrees"))
    for limit, field in (*limits, ("3 %", "within_3_percent"), ("5 %", "within_5_percent")):
        lines.append(f"{f'within {limit} (%)':22}{'':24}{_interval(getattr(pose, field), 0, 100):>24}")
    return lines
