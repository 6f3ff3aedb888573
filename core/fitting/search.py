"""The search for codes and unknown cameras (Eq. 5): six steps, the methods of :class:`Search` in their order.

A hypothesis is a camera per photo and a pair of codes. All hypotheses are one batch of one network call. Codes enter as
biases, so the cost of a hypothesis is that of its points.
"""

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import torch

from core.fitting.biases import hypothesis_codes
from core.fitting.confidence import confidence
from core.fitting.descent import log_ratio, optimise, refine, score, select
from core.fitting.free import free_object, free_steps
from core.fitting.gauss_newton import camera_uncertainty
from core.fitting.hypotheses import DivergedError, Hypothesis, HypothesisBatch, concatenate, other_basins, to_hypotheses
from core.fitting.initial import initial_hypotheses, local_hypotheses, resume_from
from core.fitting.problem import FitJob, Problem
from core.fitting.rivals import optimise_rivals
from core.fitting.schedule import Schedule, Stage, build_schedule
from core.models.latents import Latents
from core.models.model import Model

RESTART_BELOW = 0.65  # confidence of a camera below which the search restarts; belongs to CALIBRATION
_Value = TypeVar("_Value")


class SearchResult(NamedTuple):
    """The winner of a search, and the assessment of its camera."""

    winner: HypothesisBatch  # a single one
    runner_up: HypothesisBatch | None = None  # best hypothesis of another basin, if one camera is unknown
    margin: float = math.inf  # log ratio of the runner-up's loss to the winner's
    uncertainty: float | None = None  # degrees, once assessed, if a camera is searched
    view_margins: tuple[float | None, ...] = ()  # of each camera among several, for constant codes


@dataclass(frozen=True, eq=False)
class SearchState:
    """The state of a search after an iteration."""

    search: "Search"
    batch: HypothesisBatch  # the optimised hypotheses
    result: SearchResult | None = None  # its winner leads, once it exists
    remaining: int | None = None  # iterations that follow, if they may differ from the schedule
    finished: bool = False  # the result is complete; another search may follow
    freed: HypothesisBatch | None = None  # the result with free biases, in the free stage
    origin: Latents | None = None  # the codes whose biases are free, with the offsets of a free network

    @property
    def leader(self) -> HypothesisBatch:
        """The leading hypothesis of codes. Raises :class:`DivergedError` if all have diverged."""
        return self.result.winner if self.result else self.batch.best

    @property
    def left_out(self) -> tuple[int, ...]:
        """Numbers of the job's photos that show another object."""
        included = self.search.problem.included.tolist()
        return tuple(view for view, used in zip(self.search.views, included, strict=True) if not used)

    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Return the leader, then the others, as :attr:`core.fitting.steps.FitStep.hypotheses`."""
        result = self.result
        freed = () if self.freed is None else self._hypotheses(self.freed, self.origin)
        batches = [self.batch]
        if result and self.batch is result.winner:
            batches = [] if freed else [self.batch]
            batches += [] if result.runner_up is None else [result.runner_up]
        elif result:
            batches = [result.winner, self.batch]
        return *freed, *(hypothesis for batch in batches for hypothesis in self._hypotheses(batch))

    def _hypotheses(self, batch: HypothesisBatch, origin: Latents | None = None) -> tuple[Hypothesis, ...]:
        problem = self.search.problem
        codes = hypothesis_codes(problem.model, batch.parameters, problem.spaces, origin)
        return to_hypotheses(problem.shown_model, batch, problem.cameras, codes)


Searching = Generator[SearchState, None, _Value]  # yields the state after every iteration, returns a value


@dataclass(frozen=True, eq=False)
class Search:
    """The search for the codes of some photos and for at most one unknown camera."""

    problem: Problem
    schedule: Schedule
    job: FitJob
    generator: torch.Generator
    views: Sequence[int]  # photos of the job in this search
    earlier: SearchResult | None = None  # of the searches before a restart; it leads until this one ends

    @classmethod
    def of(cls, model: Model, job: FitJob) -> "Search":
        """Build from a job. Raises ``ValueError`` if a photo shows no object."""
        generator = torch.Generator().manual_seed(job.seed)
        problem = Problem.of(model, job, generator)
        count = len(job.photos)
        unknown = int(problem.unknown.sum())
        added = None if job.resume_from is None else len(job.added)
        schedule = build_schedule(job.settings, job.components, unknown, count, added)
        return cls(problem, schedule, job, generator, range(count))

    def run(self) -> Iterator[SearchState]:
        """Run the six steps; yield the state after every iteration. Raises :class:`DivergedError`."""
        searched = yield from self.find()
        if self.schedule.free:
            yield from searched.search.free(searched, self.schedule.free)

    def find(self) -> Searching[SearchState]:
        """Run the steps of the codes and return the last state."""
        may_restart = self.problem.has_one_unknown and not self.job.resume_from
        return (yield from self.restart(self.rank(), self.job.settings.max_restarts if may_restart else 0))

    def rank(self) -> HypothesisBatch:
        """1. Return hypotheses at the best cameras of the view bank, or the one that the job resumes from."""
        problem = self.problem
        if self.job.resume_from:
            return resume_from(problem.model, self.job.photos, problem.cameras, self.job.resume_from, problem.spaces)
        return initial_hypotheses(problem, self.schedule.stages[0].hypotheses, self.generator)

    def explore(self, initial: HypothesisBatch) -> Searching[tuple[HypothesisBatch, HypothesisBatch]]:
        """2. Optimise and prune hypotheses, then others around the best; return the best, and all that are left."""
        problem = self.problem
        schedule = self.schedule
        coarse = initial
        for coarse in optimise(problem, initial, schedule.coarse, self.generator):
            yield SearchState(self, coarse, self.earlier)
        local = local_hypotheses(problem, coarse, schedule.local[0].hypotheses) if schedule.coarse else coarse
        batch = local
        for batch in optimise(problem, local, schedule.local, self.generator):
            # The coarse winner is kept, so that stopping early returns the best of all.
            yield SearchState(self, concatenate(batch, coarse.best) if schedule.coarse else batch, self.earlier)
        return select(problem, batch, coarse, schedule.final), batch

    def refine(self, best: HypothesisBatch) -> Searching[HypothesisBatch]:
        """3. Refine the best hypothesis."""
        refined = refine(self.problem, best, self.schedule.final, self.generator)
        return (yield from self._all_but_last(refined))

    def assess(self, best: HypothesisBatch, others: HypothesisBatch) -> Searching[SearchResult]:
        """4. Optimise the rivals of a single unknown camera; add runner-up, margin and uncertainty.

        A better rival is refined and takes the winner's place, unless the fit resumed. Of several unknown cameras the
        rivals are the other hypotheses.
        """
        problem = self.problem
        final = self.schedule.final
        if not bool(problem.unknown.any()):
            return SearchResult(best)
        if problem.has_one_unknown:
            optimised = optimise_rivals(problem, best, self.schedule, self.generator)
            rivals = yield from self._all_but_last(optimised, best)
        else:
            rivals = score(problem, others, final.robust_scale)
        candidates = concatenate(best, rivals)
        if candidates.leader and self.schedule.rivals:
            best = yield from self.refine(candidates.best)
        result = with_runner_up(problem, best, candidates)
        inputs = problem.validation, final, problem.objective(final.robust_scale), problem.free, problem.unknown
        uncertainty = camera_uncertainty(problem.model, result.winner, *inputs)
        return result._replace(uncertainty=math.degrees(uncertainty))

    def once(self, initial: HypothesisBatch) -> Searching[SearchResult]:
        """Run steps 2 to 4."""
        best, batch = yield from self.explore(initial)
        best = yield from self.refine(best)
        return (yield from self.assess(best, concatenate(batch, initial)))

    def restart(self, initial: HypothesisBatch, restarts: int) -> Searching[SearchState]:
        """5. Search, then again while in doubt, with other pixels, assuming that an occluder may hide the object.

        Args:
            restarts: largest number of further searches.
        """
        result = yield from self.once(initial)
        if self.earlier:
            winner = score(self.problem, self.earlier.winner, self.schedule.final.robust_scale)
            result = better_of(self.problem, self.earlier._replace(winner=winner), result)
        if not (restarts and is_doubtful(result)):
            return (yield from self.end(result))
        searched = SearchState(self, result.winner, result, remaining=self.schedule.steps, finished=True)
        yield searched
        occluded = replace(self, problem=replace(self.problem, occluded=True), earlier=result)
        try:
            return (yield from occluded.restart(initial, restarts - 1))
        except DivergedError:
            return searched

    def end(self, result: SearchResult) -> Searching[SearchState]:
        """Yield and return the last state of the codes."""
        finished = self.schedule.free is None
        searched = SearchState(self, result.winner, result, self.schedule.free_steps, finished)
        yield searched
        return searched

    def free(self, searched: SearchState, stage: Stage) -> Iterator[SearchState]:
        """6. Free the biases, then the network."""
        inputs = self.problem, searched.leader, stage
        steps = free_steps(*inputs)
        for number, (origin, freed) in enumerate(free_object(*inputs, self.generator), 1):
            finished = number == steps
            yield replace(searched, freed=freed, origin=origin, remaining=steps - number, finished=finished)

    def _all_but_last(
        self, batches: Iterator[HypothesisBatch], winner: HypothesisBatch | None = None
    ) -> Searching[HypothesisBatch]:
        """Yield the states of all batches but the last, and return the last: its state needs what follows."""
        batch = next(batches)
        for following in batches:
            yield SearchState(self, batch, self.earlier or SearchResult(winner or batch))
            batch = following
        return batch


def with_runner_up(problem: Problem, winner: HypothesisBatch, candidates: HypothesisBatch) -> SearchResult:
    """Pair the winner with the best of the candidates that lie in another basin, if any."""
    rivals = other_basins(candidates, winner, problem.unknown)
    if not len(rivals):
        return SearchResult(winner)
    return SearchResult(winner, rivals.best, log_ratio(rivals.best.loss, winner.loss))


def is_doubtful(result: SearchResult) -> bool:
    """True if the camera deserves another search."""
    return result.uncertainty is not None and confidence(result.margin, result.uncertainty) < RESTART_BELOW


def better_of(problem: Problem, first: SearchResult, second: SearchResult) -> SearchResult:
    """Return the better of two searches.

    If they agree on the camera, the margin is the smaller of the two; else it is at most the margin over the worse one.
    """
    best, worse = sorted((first, second), key=lambda result: float(result.winner.loss))
    compared = with_runner_up(problem, best.winner, worse.winner)
    closest = min(best, compared if compared.runner_up else worse, key=lambda result: result.margin)
    return best._replace(runner_up=closest.runner_up, margin=closest.margin)
