"""The paper's own recipe (section 3.3), the baseline of every chart: one random start, mean codes, AdamW, Eq. 5."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool
from torch import Tensor

from core.fitting import fit as search
from core.fitting.biases import hypothesis_codes
from core.fitting.hypotheses import HypothesisBatch, Parameters, clamp_parameters, to_hypotheses
from core.fitting.initial import random_angles, resume_from
from core.fitting.objective import ObjectiveValue, paper_objective
from core.fitting.observations import Observation, sample_pixels
from core.fitting.problem import SCORING_RAYS, FitJob, nominal_camera
from core.fitting.settings import FitSettings, PaperSettings
from core.fitting.steps import FitStep
from core.geometry.camera import Camera
from core.metrics import psnr_from_mse
from core.models.codes import CodeSpace
from core.models.model import Model
from core.runtime.modes import isolated

_RATES = {"angles": 0.1, "distance": 0.01, "codes": 0.01}  # learning rates; rad, scene units, numbers of a code
_HALVED_EVERY = 50  # steps, in the authors' code
_SCORE_EVERY = 10  # steps between two scores; the best one is the result


def fit_as_set(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Fit by the paper's recipe if the job has :class:`PaperSettings`, else by :func:`core.fitting.fit.fit`."""
    return fit(model, job) if isinstance(job.settings, PaperSettings) else search.fit(model, job)


@isolated
def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Fit by the paper's recipe; yield steps like :func:`core.fitting.fit.fit`, without margin and photo detail.

    Raises ``ValueError`` for photos that join an earlier result.
    """
    if job.added:
        raise ValueError("the paper's recipe adds no photos to an object")
    began = time.perf_counter()
    generator = torch.Generator().manual_seed(job.seed)
    settings = job.settings
    observations = tuple(Observation.of(replace(photo, blur=0.0), model) for photo in job.photos)
    cameras = tuple(photo.camera or nominal_camera(photo, model) for photo in job.photos)
    unknown = torch.tensor([photo.camera is None for photo in job.photos])
    spaces = CodeSpace.identity(model.codes.shapes.shape[-1]), CodeSpace.identity(model.codes.textures.shape[-1])
    scoring = sample_pixels(observations, SCORING_RAYS, generator)
    if job.resume_from:
        initial = resume_from(model, job.photos, cameras, job.resume_from, spaces)
    else:
        initial = initialise(model, cameras, unknown, generator)
    best = replace(initial, loss=torch.full_like(initial.loss, math.inf))
    for step, batch in enumerate(optimise(model, initial, observations, settings, unknown, generator), 1):
        if step % _SCORE_EVERY == 0 or step == settings.steps:
            with torch.no_grad():
                value = paper_objective(model, batch.parameters, scoring, settings.samples, settings.code_prior, None)
            best = min(best, _with_loss(batch, value), key=lambda candidate: float(candidate.loss))
        leading = batch if step < settings.steps and bool(batch.loss.isfinite().all()) else best
        codes = hypothesis_codes(model, leading.best.parameters, spaces)
        (hypothesis,) = to_hypotheses(model, leading.best, cameras, codes)
        yield FitStep(
            step,
            settings.steps,
            hypothesis.origin,
            hypothesis.loss,
            psnr_from_mse(float(leading.squared_error)),
            time.perf_counter() - began,
            hypothesis.cameras,
            hypothesis.instance,
            hypotheses=(hypothesis,),
        )


def initialise(
    model: Model, cameras: Sequence[Camera], unknown: Bool[Tensor, "views"], generator: torch.Generator
) -> HypothesisBatch:
    """Return one hypothesis: mean codes, and for unknown cameras random angles on the upper half of the sphere."""
    angles = torch.tensor([(camera.azimuth, camera.elevation) for camera in cameras])
    angles = torch.where(unknown[:, None], random_angles(len(cameras), generator), angles)[None]
    distance = torch.tensor([[math.log(camera.distance / model.distance) for camera in cameras]])
    crop_transform = torch.zeros(1, len(cameras), 4)
    codes = (code[None] for code in (model.codes.mean.shape, model.codes.mean.texture))
    return HypothesisBatch.of(Parameters(angles, distance, torch.zeros_like(distance), crop_transform, *codes))


def optimise(
    model: Model,
    hypothesis: HypothesisBatch,
    observations: Sequence[Observation],
    settings: FitSettings,
    unknown: Bool[Tensor, "views"],
    generator: torch.Generator,
) -> Iterator[HypothesisBatch]:
    """Yield the hypothesis after every AdamW step, with the loss from before it; infinite after divergence.

    Every step samples new pixels.
    """
    searched = Parameters(*(values.clone().requires_grad_() for values in hypothesis.parameters))
    rates = {
        "angles": _RATES["angles"],
        "distance": _RATES["distance"] / model.distance,
        "shape": _RATES["codes"],
        "texture": _RATES["codes"],
    }
    optimizer = torch.optim.AdamW([{"params": [getattr(searched, name)], "lr": rate} for name, rate in rates.items()])
    halving = torch.optim.lr_scheduler.StepLR(optimizer, _HALVED_EVERY, 0.5)
    for _ in range(settings.steps):
        pixels = sample_pixels(observations, settings.rays, generator)
        jitter = torch.rand(pixels.points.shape[:2], generator=generator) - 0.5
        optimizer.zero_grad()
        value = paper_objective(model, searched, pixels, settings.samples, settings.code_prior, jitter)
        value.objective.sum().backward()
        optimizer.step()
        halving.step()
        with torch.no_grad():
            _restore_known(searched, hypothesis.parameters, unknown)
        parameters = Parameters(*(values.detach().clone() for values in searched))
        yield _with_loss(replace(hypothesis, parameters=parameters), value)


def _with_loss(hypothesis: HypothesisBatch, value: ObjectiveValue) -> HypothesisBatch:
    loss = value.objective.detach()
    if not all(bool(values.isfinite().all()) for values in (loss, *hypothesis.parameters)):
        loss = torch.full_like(loss, math.inf)
    return replace(hypothesis, loss=loss, squared_error=value.squared_error)


def _restore_known(searched: Parameters, previous: Parameters, unknown: Bool[Tensor, "views"]) -> None:
    """Clamp unknown cameras and restore known ones, since AdamW moves all."""
    bounded = clamp_parameters(searched, unknown)
    searched.angles.copy_(torch.where(unknown[:, None], bounded.angles, previous.angles))
    searched.distance.copy_(torch.where(unknown, bounded.distance, previous.distance))
