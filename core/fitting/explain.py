"""The course of a fit: candidate cameras, survivors of each stage, and the value of each loss term."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import torch

from core.fitting.hypotheses import Hypothesis
from core.fitting.initial import resume_from
from core.fitting.objective import evaluate_objective
from core.fitting.problem import FitJob, Problem
from core.fitting.schedule import build_schedule
from core.fitting.steps import FitStep
from core.models.model import Model
from core.photos.ranking import CandidateCameras, ObjectMask, rank_cameras

_CANDIDATES = 12  # cameras of the view bank that are shown


class Explanation(NamedTuple):
    """The course of a fit; categories and candidates are those of its first photo."""

    categories: dict[str, float]  # probability of each category by name
    candidates: CandidateCameras | None  # best matching views of the view bank; None for a known camera
    stages: tuple[FitStep, ...]  # last step of each stage, with the remaining hypotheses
    terms: tuple[dict[str, float], ...]
    """Loss terms by name of the last step's first two hypotheses, on the same pixels. After a whole fit, these are the
    result and the runner-up."""


def explain(model: Model, job: FitJob, steps: Iterable[FitStep]) -> Explanation:
    """Explain a fit from its job and all steps that :func:`core.fitting.fit.fit` yielded.

    Raises ``ValueError`` without steps.
    """
    stages = _last_of_stages(steps)
    photo, generator = job.photos[0], torch.Generator().manual_seed(job.seed)
    job = replace(job, settings=job.settings.for_box(model.extent))  # as the fit has it
    problem = replace(Problem.of(model.soft, job, generator), occluded=stages[-1].restart)
    candidates = None
    if photo.camera is None:
        image = ObjectMask(photo.mask, problem.cameras[0].focal, photo.unseen)
        candidates = rank_cameras(job.bank, image, _CANDIDATES, problem.viewpoints[0], photo.cropped)
    terms = tuple(_terms(problem, job, one) for one in stages[-1].hypotheses[:2])
    return Explanation(photo.categories, candidates, stages, terms)


def _last_of_stages(steps: Iterable[FitStep]) -> tuple[FitStep, ...]:
    ends = {step.stage: step for step in steps}
    if not ends:
        raise ValueError("the fit made no step")
    return tuple(ends.values())


@torch.no_grad()
def _terms(problem: Problem, job: FitJob, found: Hypothesis) -> dict[str, float]:
    final = build_schedule(job.settings, job.components, bool(problem.unknown.any())).final
    at = resume_from(problem.model, problem.photos, problem.cameras, found, problem.spaces)
    objective, samples = problem.objective(final.robust_scale), problem.settings.samples
    value = evaluate_objective(problem.model, at.parameters, problem.scoring, samples, objective)
    names = (term.__name__.removesuffix("_term").replace("_", " ") for term in objective.terms)
    return dict(zip(names, value.terms[:, 0].tolist(), strict=True))
