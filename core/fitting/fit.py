"""Fitting (Eq. 5): from photos of an object to its codes and unknown cameras, as a stream of steps.

The search has six steps, the methods of :class:`core.fitting.search.Search`. Several unknown cameras have
:class:`core.fitting.anchors.SetSearch`. The paper's own recipe is :mod:`core.fitting.paper`.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from core.fitting.anchors import GrowingSearch, SetSearch
from core.fitting.category_check import category_likelihood
from core.fitting.hypotheses import Hypothesis, HypothesisBatch, to_cameras
from core.fitting.photo_views import detailed_instance
from core.fitting.problem import FitJob, Problem
from core.fitting.search import Search, SearchState
from core.fitting.settings import PRESETS, FitSettings, PaperSettings
from core.fitting.steps import FitStep, RunnerUp
from core.geometry.camera import Camera
from core.metrics import psnr_from_mse
from core.models.model import Model
from core.runtime.modes import isolated

__all__ = ["PRESETS", "FitJob", "FitSettings", "FitStep", "Hypothesis", "RunnerUp", "fit"]


@isolated
def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Find codes and unknown cameras: yield a FitStep per iteration, the last one with the best result.

    The search uses the field without contrast (:attr:`core.models.model.Model.soft`), renders of the result have
    contrast. The model does not change, and the same seed gives the same steps. To stop, abandon the generator and pass
    the last step to :func:`core.fitting.photo_views.with_photo_detail`.

    Raises ``ValueError`` if a photo shows no object, if every hypothesis diverged, or for the paper's settings.
    """
    if type(job.settings) is PaperSettings:
        raise ValueError("these settings are of the paper's recipe: core.fitting.paper.fit")
    began = time.perf_counter()
    settings = job.settings.for_box(model.extent)
    settings = replace(settings, estimate_focal=settings.estimate_focal or job.tells_focal)
    # Where the network paints the background, its colour would be free, too.
    job = replace(job, settings=replace(settings, free_steps=0) if model.white_from_network else settings)
    several = not job.resume_from and sum(photo.camera is None for photo in job.photos) > 1
    search = (GrowingSearch if job.added else SetSearch if several else Search).of(model, job)
    steps = search.schedule.steps
    cameras = search.problem.cameras
    if job.resume_from:
        cameras = (*job.resume_from.cameras, *cameras[job.added.start :])
    for step, state in enumerate(search.run(), 1):
        steps = steps if state.remaining is None else step + state.remaining
        fit_step = _to_step(job, state, cameras, step, steps, time.perf_counter() - began)
        cameras = fit_step.cameras
        yield fit_step


def _to_step(
    job: FitJob, state: SearchState, cameras: Sequence[Camera], step: int, steps: int, seconds: float
) -> FitStep:
    """Return the state of a search as a step of the stream.

    Args:
        cameras: of all photos in the step before.
        step, steps, seconds: see :class:`FitStep`.
    """
    searched = state.leader
    hypotheses = state.hypotheses()
    leader = hypotheses[0]
    views = state.search.views
    by_view = dict(enumerate(cameras)) | dict(zip(views, leader.cameras, strict=True))
    result = state.result if state.result and math.isfinite(state.result.margin) else None
    return FitStep(
        step,
        steps,
        leader.origin,
        leader.loss,
        psnr_from_mse(float((state.freed or searched).squared_error)),
        seconds,
        tuple(by_view.values()),
        detailed_instance(job.photos, leader, state.left_out) if state.finished else leader.instance,
        active=len(state.batch),
        restart=state.search.earlier is not None,
        search_psnr=psnr_from_mse(float(searched.squared_error)) if state.freed else None,
        runner_up=result and _runner_up(state.search.problem, result.runner_up),
        # A fit resumed from one hypothesis has no competitors, so the margin is meaningless.
        margin=None if (job.resume_from and not job.added) or not result else result.margin,
        uncertainty=result and result.uncertainty,
        hypotheses=hypotheses,
        category_likelihood=category_likelihood(state.search.problem.model.category, job.photos),
        mask_confidence=math.prod(photo.mask_confidence for photo in job.photos) ** (1 / len(job.photos)),
        view_margins=state.result.view_margins if state.result else (),
        left_out=state.left_out,
    )


def _runner_up(problem: Problem, runner_up: HypothesisBatch | None) -> RunnerUp | None:
    if runner_up is None:
        return None
    return RunnerUp(to_cameras(problem.model, runner_up.parameters, 0, problem.cameras), float(runner_up.loss))
