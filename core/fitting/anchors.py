"""Cameras of several photos of one object: the object of one photo places the other photos.

Each photo is fitted alone. From its object, and from its runner-up's, the cameras of the other photos are searched with
constant codes. A camera that no single photo gives away is plain once the object is known, and the sum of the losses
tells right anchors from wrong ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from core.fitting.descent import log_ratio, optimise, score
from core.fitting.hypotheses import Hypothesis, HypothesisBatch, Parameters, concatenate, one_view, other_basins
from core.fitting.initial import initial_hypotheses, resume_from
from core.fitting.problem import Problem
from core.fitting.schedule import build_schedule
from core.fitting.search import Search, Searching, SearchResult, SearchState, with_runner_up

_CLEAR_MARGIN = 1.2  # of a photo alone, above which its runner-up places no photos
_LARGEST_MARGIN = 5.0  # of a photo of which all rivals find the same camera
_MISFIT = 1.0
"""Log ratio of a photo's losses, with the common codes and with its own, from which it shows another object.

Photos of one object have at most 0.5, of another object 0.9 to 2.3."""
_DISAGREEMENT = 0.45
"""Mean of this log ratio over the photos from which some show another object: common codes can explain two similar cars
about equally badly. Photos of one object have at most 0.26."""


@dataclass(frozen=True, eq=False)
class SingleFit:
    """The fit of one photo with an unknown camera, together with all photos of known cameras."""

    views: tuple[int, ...]  # photos of the fit, the unknown one last
    alone: Search  # of the unknown photo
    starts: HypothesisBatch  # initial hypotheses of the unknown photo
    result: SearchResult

    @property
    def view(self) -> int:
        """Number of the unknown photo."""
        return self.views[-1]

    @property
    def anchors(self) -> list[HypothesisBatch]:
        """The winner and, unless it is clear, its runner-up."""
        runner_up = self.result.runner_up if self.result.margin < _CLEAR_MARGIN else None
        return [hypothesis for hypothesis in (self.result.winner, runner_up) if hypothesis]


@dataclass(frozen=True, eq=False)
class Assignment:
    """Cameras of all photos and the codes of one of them, its anchor."""

    anchor: int  # number of the photo
    hypothesis: HypothesisBatch  # a single one
    losses: Float[Tensor, "photos"]  # of each photo with these codes


@dataclass(frozen=True, eq=False)
class SetSearch(Search):
    """The search for several unknown cameras. Photos that show another object are left out."""

    def find(self) -> Searching[SearchState]:
        """Fit each photo alone, then the best assignments, without misfits; return the last state."""
        singles = list[SingleFit]()
        for view in self.problem.unknown.nonzero()[:, 0].tolist():
            single = yield from self.fit_alone(view)
            singles.append(single)
        assignments = yield from self.assign(singles)
        return (yield from self.fit_jointly(singles, assignments))

    def fit_jointly(self, singles: Sequence[SingleFit], assignments: Sequence[Assignment]) -> Searching[SearchState]:
        """Optimise the best assignments, without misfits; return the last state.

        Args:
            singles: fits of the photos that may be misfits.
        """
        search = self
        while True:
            initial = best_assignments(search.problem, assignments, self.schedule.local[0].hypotheses)
            result = yield from search.once(initial)
            misfit = find_misfit(search.problem, singles, result.winner)
            if misfit is None:
                break
            problem = search.problem.without(misfit)
            if problem.has_one_unknown and not self.job.resume_from:
                schedule = build_schedule(self.job.settings, self.job.components, 1)
                return (yield from Search(problem, schedule, self.job, self.generator, self.views).find())
            search = replace(search, problem=problem)
        margins = yield from search.view_margins(singles, result.winner)
        set_margin = min((result.margin, *(margin for margin in margins if margin is not None)))  # a margin of 0 counts
        return (yield from search.end(result._replace(view_margins=margins, margin=set_margin)))

    def fit_alone(self, view: int) -> Searching[SingleFit]:
        """Fit a photo with an unknown camera, and all photos of known cameras."""
        views = (*(~self.problem.unknown).nonzero()[:, 0].tolist(), view)
        search = self._of_views(views, torch.Generator().manual_seed(self.job.seed))
        starts = search.rank()
        result = yield from search.once(starts)
        if len(views) == 1:
            return SingleFit(views, search, starts, result)
        alone = self._of_views((view,), search.generator)
        starts = initial_hypotheses(alone.problem, len(starts), search.generator)
        return SingleFit(views, alone, starts, result)

    def _of_views(self, views: tuple[int, ...], generator: torch.Generator) -> Search:
        """Return the search of some photos, the last with an unknown camera."""
        job = replace(self.job, photos=tuple(self.job.photos[view] for view in views), resume_from=None)
        problem = Problem.of(self.problem.shown_model, job, generator)
        schedule = build_schedule(job.settings.for_anchor(), job.components, 1, len(views))
        return Search(problem, schedule, job, generator, views)

    def assign(self, singles: Sequence[SingleFit]) -> Searching[list[Assignment]]:
        """Return an assignment for every anchor.

        Args:
            singles: one fit of each photo with an unknown camera.
        """
        assignments = []
        for single in singles:
            for anchor in single.anchors:
                cameras = {single.views: anchor}
                for further in singles:
                    if further is not single:
                        placed = yield from self.place(further, anchor.parameters)
                        cameras[further.view,] = placed.best
                assignments.append(_merge(single.view, anchor, cameras, len(self.views)))
        return assignments

    def place(self, single: SingleFit, codes: Parameters) -> Searching[HypothesisBatch]:
        """Return the best cameras of a photo for the codes of a single hypothesis, with their losses."""
        count = len(single.starts)
        shape = codes.shape.expand(count, -1)
        texture = codes.texture.expand(count, -1)
        starts = replace(single.starts, parameters=single.starts.parameters._replace(shape=shape, texture=texture))
        problem = single.alone.problem
        batch = starts
        for batch in optimise(problem, starts, self.schedule.placing, self.generator):
            yield SearchState(single.alone, batch)
        return score(problem, batch, self.schedule.final.robust_scale)

    def view_margins(
        self, singles: Sequence[SingleFit], winner: HypothesisBatch
    ) -> Searching[tuple[float | None, ...]]:
        """Return the margin of each photo's camera for the codes of the winner.

        None for known cameras and photos that are left out.
        """
        margins: list[float | None] = [None] * len(self.views)
        for single in singles:
            if self.problem.included[single.view]:
                rivals = yield from self.place(single, winner.parameters)
                problem = single.alone.problem
                camera = HypothesisBatch.of(one_view(winner.parameters, single.view))
                camera = score(problem, camera, self.schedule.final.robust_scale)
                margins[single.view] = min(with_runner_up(problem, camera, rivals).margin, _LARGEST_MARGIN)
        return tuple(margins)


@dataclass(frozen=True, eq=False)
class GrowingSearch(SetSearch):
    """The search for the cameras of photos that join an earlier result: its object places them, then all is refined."""

    def find(self) -> Searching[SearchState]:
        """Place the added photos and refine everything, without misfits; return the last state."""
        assert self.job.resume_from, "an earlier result grows"
        resumed = self._resume(range(self.job.added.start), self.job.resume_from)
        cameras = {tuple(range(self.job.added.start)): resumed}
        singles = list[SingleFit]()
        for view in self.job.added:
            if camera := self.job.photos[view].camera:
                hypothesis = replace(self.job.resume_from, cameras=(camera,), crop_transform=torch.zeros(1, 4))
                cameras[view,] = self._resume([view], hypothesis)
                continue
            alone = self._of_views((view,), self.generator)
            single = SingleFit((view,), alone, alone.rank(), SearchResult(resumed))
            placed = yield from self.place(single, resumed.parameters)
            cameras[view,] = placed.best
            refined = yield from alone.refine(placed.best)
            singles.append(replace(single, result=SearchResult(refined)))
        return (yield from self.fit_jointly(singles, [_merge(0, resumed, cameras, len(self.views))]))

    def _resume(self, views: Sequence[int], hypothesis: Hypothesis) -> HypothesisBatch:
        photos = [self.job.photos[view] for view in views]
        cameras = [self.problem.cameras[view] for view in views]
        return resume_from(self.problem.model, photos, cameras, hypothesis, self.problem.spaces)


def best_assignments(problem: Problem, assignments: Sequence[Assignment], count: int) -> HypothesisBatch:
    """Return at most ``count`` different assignments by their loss over the photos that are not left out."""
    included = problem.included
    batch = concatenate(
        *(
            replace(assignment.hypothesis, loss=assignment.losses[included].sum()[None])
            for assignment in assignments
            if included[assignment.anchor]
        )
    )
    batch = replace(batch, origin=torch.arange(len(batch)))
    different = concatenate(batch.best, other_basins(batch, batch.best, problem.unknown))
    return different[torch.arange(min(len(different), count))]


def find_misfit(problem: Problem, singles: Sequence[SingleFit], winner: HypothesisBatch) -> int | None:
    """Return the number of the photo that shows another object, the clearest; None if all show the same one.

    Such a photo is explained far worse by the common codes than by its own. Of two photos the first is kept.

    Args:
        winner: the hypothesis of all photos.
    """
    excess = {}
    for single in singles:
        if problem.unknown[single.view]:
            codes = one_view(winner.parameters, single.view), one_view(single.result.winner.parameters, -1)
            batches = map(HypothesisBatch.of, codes)
            common, separate = (score(single.alone.problem, batch, math.inf).loss for batch in batches)
            excess[single.view] = log_ratio(common, separate)
    agree = len(excess) == 1 or sum(excess.values()) < _DISAGREEMENT * len(excess)
    if not excess or (agree and max(excess.values()) < _MISFIT):
        return None
    return max(excess) if int(problem.included.sum()) == 2 else max(excess, key=lambda number: excess[number])


def _merge(
    number: int, anchor: HypothesisBatch, cameras: Mapping[tuple[int, ...], HypothesisBatch], photos: int
) -> Assignment:
    """Return an assignment from the hypotheses of an anchor and of the photos that it places."""
    losses = torch.zeros(photos)
    merged = [values.new_zeros(1, photos, *values.shape[2:]) for values in anchor.parameters[:4]]
    for views, batch in cameras.items():
        losses[list(views)] = batch.loss
        for all_views, values in zip(merged, batch.parameters[:4], strict=True):
            all_views[:, list(views)] = values
    fields = dict(zip(anchor.parameters._fields, merged, strict=False))
    parameters = anchor.parameters._replace(**fields)
    return Assignment(number, replace(anchor, parameters=parameters), losses)
