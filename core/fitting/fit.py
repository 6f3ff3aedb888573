"""Fitting (Eq. 5): from photos of an object to its codes and unknown cameras, in six steps.

1. Rank the cameras of the view bank.
2. Optimise hypotheses from the best cameras, then around the best of the results; prune between stages.
3. Refine the best hypothesis.
4. Assess its camera: runner-up, uncertainty, confidence.
5. Restart while the camera is in doubt.
6. Free the biases (:mod:`core.fitting.free`).

A hypothesis is a camera per photo and a pair of codes. All hypotheses are one batch of one network call. Codes enter as
biases, so the cost of a hypothesis is that of its points. The paper's own recipe is :mod:`core.fitting.paper`.
"""

import math
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from functools import partial

import torch

from core.fitting.category_check import category_likelihood
from core.fitting.confidence import witness_odds
from core.fitting.free import free_biases
from core.fitting.hypotheses import DivergedError, Hypothesis, HypothesisBatch, concatenate
from core.fitting.initial import combine_views, initial_hypotheses, local_hypotheses, resume_from
from core.fitting.photo_views import with_photo_detail
from core.fitting.problem import FitJob, Problem, witness_direction
from core.fitting.schedule import Schedule, build_schedule
from core.fitting.search import SearchResult, assess, better_of, is_doubtful, optimise, refine, score, select
from core.fitting.settings import PRESETS, FitSettings, PaperSettings
from core.fitting.steps import FitStep, RunnerUp, SearchState
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
    settings = job.settings.for_box(model.extent)
    # Where the network paints the background, its colour would be free, too.
    job = replace(job, settings=replace(settings, free_steps=0) if model.white_from_network else settings)
    began = time.perf_counter()
    generator = torch.Generator().manual_seed(job.seed)
    problem = Problem.of(model, job, generator)
    unknown = int(problem.unknown.sum())
    schedule = build_schedule(job.settings, job.components, unknown > 0, job.resume_from is not None)
    steps = schedule.steps + (unknown if unknown > 1 else 0) * sum(stage.steps for stage in schedule.coarse)
    cameras = list(problem.cameras)
    likelihood = category_likelihood(model.category, job.photos)
    masks = math.prod(photo.mask_confidence for photo in job.photos)
    for step, state in enumerate(_search(problem, schedule, job, generator), 1):
        steps = step + schedule.steps if state.restart_follows else steps
        fit_step = state.to_step(step, steps, time.perf_counter() - began)
        for view, camera in zip(state.views, fit_step.cameras, strict=True):
            cameras[view] = camera
        # A fit resumed from one hypothesis has no competitors, so the margin is meaningless.
        margin = None if job.resume_from else fit_step.margin
        pairs = zip(job.photos, cameras, strict=True)
        witness = sum(witness_odds(witness_direction(model, photo), camera.azimuth) for photo, camera in pairs)
        fit_step = replace(fit_step, cameras=tuple(cameras), margin=margin, witness=witness)
        fit_step = replace(fit_step, category_likelihood=likelihood, mask_confidence=masks)
        yield with_photo_detail(job.photos, fit_step) if state.finished else fit_step


def _search(problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator) -> Iterator[SearchState]:
    """Run the six steps; yield the state after every iteration."""
    searched = yield from _search_codes(problem, schedule, job, generator)
    if schedule.free is None or searched.result is None:
        return
    # 6. Free the biases.
    freed_states = free_biases(searched.problem, searched.result.winner, schedule.free, generator)
    for number, (origin, freed) in enumerate(freed_states, 1):
        finished = number == schedule.free.steps
        yield searched._replace(freed=freed, origin=origin, restart_follows=False, finished=finished)


def _search_codes(
    problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator
) -> Generator[SearchState, None, SearchState]:
    """Run the first five steps; yield the state after every iteration and return the last."""
    # 1. Rank the view bank.
    initial = yield from _initial(problem, schedule, job, generator)
    result: SearchResult | None = None
    for attempt in range(1 + job.settings.max_restarts):
        if attempt:
            problem = replace(problem, occluded=True)
        state = partial(SearchState, problem, range(len(job.photos)), restart=attempt > 0)
        try:
            assessed = yield from _search_once(problem, schedule, job, generator, initial, state, result)
        except DivergedError:
            if result is None:
                raise
            break  # the result of the earlier searches has been yielded
        if result:
            first = score(problem, result.winner, schedule.final.robust_scale)  # by the objective of the later search
            result = better_of(problem, result._replace(winner=first), assessed)
        else:
            result = assessed
        # 5. Restart while in doubt, with other pixels, assuming that an occluder may hide parts of the object.
        restarts = attempt < job.settings.max_restarts and not job.resume_from and is_doubtful(result)
        searched = state(result.winner, result, restart_follows=restarts, finished=restarts or schedule.free is None)
        yield searched
        if not restarts:
            break
    return searched


def _search_once(
    problem: Problem,
    schedule: Schedule,
    job: FitJob,
    generator: torch.Generator,
    initial: HypothesisBatch,
    state: Callable[[HypothesisBatch, SearchResult | None], SearchState],
    earlier: SearchResult | None,
) -> Generator[SearchState, None, SearchResult]:
    """Run steps 2 to 4 once. Raises :class:`DivergedError`.

    Args:
        state: makes the state of hypotheses and a result.
        earlier: result of the searches before; it leads until this one ends.
    """
    # 2. Optimise and prune hypotheses: from the best cameras of the bank, then around the best results.
    coarse = initial
    for coarse in optimise(problem, initial, schedule.coarse, generator):
        yield state(coarse, earlier)
    local = local_hypotheses(problem, coarse, schedule.local[0].hypotheses) if schedule.coarse else coarse
    batch = local
    for batch in optimise(problem, local, schedule.local, generator):
        # The coarse winner is kept, so that stopping early returns the best of all.
        yield state(concatenate(batch, coarse.best) if schedule.coarse else batch, earlier)
    # 3. Refine the best.
    selected = select(problem, batch, coarse, schedule.final, job.resume_from is not None)
    refined = selected.winner
    for number, refined in enumerate(refine(problem, selected.winner, schedule.final, generator), 1):
        if number < schedule.final.steps:
            yield state(refined, earlier or selected._replace(winner=refined))
    # 4. Runner-up, uncertainty, confidence.
    return assess(problem, selected, refined, schedule.final)


def _initial(
    problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator
) -> Generator[SearchState, None, HypothesisBatch]:
    """Find and return the first hypotheses.

    With several unknown cameras, each first gets a coarse search of its own, whose states are yielded.
    """
    if job.resume_from:
        return resume_from(problem.model, job.photos, problem.cameras, job.resume_from, problem.spaces)
    count = schedule.stages[0].hypotheses
    unknown = problem.unknown.nonzero()[:, 0].tolist()
    if len(unknown) < 2:
        return initial_hypotheses(problem, count, generator)
    fixed = (~problem.unknown).nonzero()[:, 0].tolist()
    searches = []
    for view in unknown:
        views = [*fixed, view]
        generator = torch.Generator().manual_seed(job.seed)
        photos = tuple(job.photos[index] for index in views)
        subproblem = Problem.of(problem.shown_model, replace(job, photos=photos), generator)
        batch = first = initial_hypotheses(subproblem, count, generator)
        for batch in optimise(subproblem, first, schedule.coarse, generator):
            yield SearchState(subproblem, views, batch)
        searches.append((views, batch))
    return combine_views(searches, len(job.photos), count)
