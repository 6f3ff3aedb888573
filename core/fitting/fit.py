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
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from functools import partial

import torch

from core.fitting.anchors import SingleFit, best_assignments, find_assignments, find_misfit, view_margins
from core.fitting.category_check import category_likelihood
from core.fitting.confidence import witness_odds
from core.fitting.free import free_biases
from core.fitting.hypotheses import DivergedError, Hypothesis, HypothesisBatch, concatenate
from core.fitting.initial import initial_hypotheses, local_hypotheses, resume_from
from core.fitting.photo_views import with_photo_detail
from core.fitting.problem import FitJob, Problem, witness_direction
from core.fitting.rivals import optimise_rivals
from core.fitting.schedule import Schedule, build_schedule
from core.fitting.search import (
    SearchResult,
    assess,
    better_of,
    is_doubtful,
    optimise,
    refine,
    score,
    select,
    with_runner_up,
)
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
    schedule = build_schedule(job.settings, job.components, unknown, len(job.photos), job.resume_from is not None)
    steps = schedule.steps
    if schedule.placing:  # each photo alone, then by the object of each other one and of its runner-up
        alone = build_schedule(job.settings.for_anchor(), job.components, 1).steps
        steps += unknown * (alone + 2 * (unknown - 1) * sum(stage.steps for stage in schedule.placing))
    cameras = list(problem.cameras)
    likelihood = category_likelihood(model.category, job.photos)
    masks = math.prod(photo.mask_confidence for photo in job.photos) ** (1 / len(job.photos))
    for step, state in enumerate(_search(problem, schedule, job, generator), 1):
        steps = steps if state.remaining is None else step + state.remaining
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
    search = _search_set if schedule.placing else _search_codes
    searched = yield from search(problem, schedule, job, generator)
    if schedule.free is None or searched.result is None:
        return
    # 6. Free the biases.
    freed_states = free_biases(searched.problem, searched.result.winner, schedule.free, generator)
    for number, (origin, freed) in enumerate(freed_states, 1):
        finished = number == schedule.free.steps
        yield searched._replace(freed=freed, origin=origin, remaining=None, finished=finished)


def _search_codes(
    problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator
) -> Generator[SearchState, None, SearchState]:
    """Run the first five steps; yield the state after every iteration and return the last."""
    # 1. Rank the view bank.
    initial = _initial(problem, schedule, job, generator)
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
        may_restart = attempt < job.settings.max_restarts and not job.resume_from and problem.has_one_unknown
        restarts = may_restart and is_doubtful(result)
        finished = restarts or schedule.free is None
        remaining = schedule.steps if restarts else schedule.free_steps
        searched = state(result.winner, result, remaining=remaining, finished=finished)
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
    def refined_states(refined: HypothesisBatch) -> SearchState:
        return state(refined, earlier or SearchResult(refined))

    best = select(problem, batch, coarse, schedule.final)
    best = yield from _all_but_last(refine(problem, best, schedule.final, generator), refined_states)
    # 4. Optimise its rivals; a better one takes its place, unless the fit resumed. Uncertainty, confidence.
    rivals = score(problem, concatenate(batch, initial) if schedule.placing else batch, schedule.final.robust_scale)
    if problem.has_one_unknown:
        rivals = yield from _all_but_last(
            optimise_rivals(problem, best, schedule, generator),
            lambda batch: state(batch, earlier or SearchResult(best)),
        )
    candidates = concatenate(best, rivals)
    if candidates.leader and schedule.rivals:
        refining = refine(problem, candidates.best, schedule.final, generator)
        best = yield from _all_but_last(refining, refined_states)
    return assess(problem, with_runner_up(problem, best, candidates), schedule.final)


def _all_but_last(
    batches: Iterator[HypothesisBatch], to_state: Callable[[HypothesisBatch], SearchState]
) -> Generator[SearchState, None, HypothesisBatch]:
    """Yield the states of all batches but the last, and return the last: its state needs what follows."""
    batch = next(batches)
    for following in batches:
        yield to_state(batch)
        batch = following
    return batch


def _initial(problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator) -> HypothesisBatch:
    """Return the first hypotheses."""
    if job.resume_from:
        return resume_from(problem.model, job.photos, problem.cameras, job.resume_from, problem.spaces)
    return initial_hypotheses(problem, schedule.stages[0].hypotheses, generator)


def _search_set(
    problem: Problem, schedule: Schedule, job: FitJob, generator: torch.Generator
) -> Generator[SearchState, None, SearchState]:
    """Find several unknown cameras: fit each photo alone, then the best assignments (:mod:`core.fitting.anchors`).

    Photos that show another object are left out. Yields the state after every iteration and returns the last.
    """
    fixed = (~problem.unknown).nonzero()[:, 0].tolist()
    singles = []
    for view in problem.unknown.nonzero()[:, 0].tolist():
        single = yield from _fit_alone(problem, job, (*fixed, view))
        singles.append(single)
    assignments = yield from find_assignments(problem, singles, schedule, generator)
    while True:
        state = partial(SearchState, problem, range(len(job.photos)))
        initial = best_assignments(problem, assignments, schedule.local[0].hypotheses)
        result = yield from _search_once(problem, schedule, job, generator, initial, state, None)
        misfit = find_misfit(problem, singles, result.winner)
        if misfit is None:
            break
        problem = problem.without(misfit)
        if problem.has_one_unknown:
            alone = build_schedule(job.settings, job.components, 1)
            return (yield from _search_codes(problem, alone, job, generator))
    margins = yield from view_margins(problem, singles, result.winner, schedule, generator)
    known = [margin for margin in margins if margin is not None]  # a margin of 0 counts
    result = result._replace(view_margins=margins, margin=min(result.margin, *known))
    searched = state(result.winner, result, remaining=schedule.free_steps, finished=schedule.free is None)
    yield searched
    return searched


def _fit_alone(problem: Problem, job: FitJob, views: tuple[int, ...]) -> Generator[SearchState, None, SingleFit]:
    """Fit the last of some photos, and the others, whose cameras are known."""
    generator = torch.Generator().manual_seed(job.seed)

    def problem_of(numbers: Sequence[int]) -> Problem:
        photos = tuple(job.photos[number] for number in numbers)
        return Problem.of(problem.shown_model, replace(job, photos=photos), generator)

    subproblem = problem_of(views)
    schedule = build_schedule(job.settings.for_anchor(), job.components, 1, len(views))
    initial = initial_hypotheses(subproblem, schedule.stages[0].hypotheses, generator)
    state = partial(SearchState, subproblem, views)
    result = yield from _search_once(subproblem, schedule, job, generator, initial, state, None)
    if len(views) == 1:
        return SingleFit(views, subproblem, initial, result)
    alone = problem_of(views[-1:])
    return SingleFit(views, alone, initial_hypotheses(alone, len(initial), generator), result)
