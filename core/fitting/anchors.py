"""Cameras of several photos of one object: the object of one photo places the other photos.

Each photo is fitted alone. From its object, and from its runner-up's, the cameras of the other photos are searched with
constant codes. A camera that no single photo gives away is plain once the object is known, and the sum of the losses
tells right anchors from wrong ones.
"""

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from core.fitting.hypotheses import HypothesisBatch, Parameters, concatenate, one_view, other_basins
from core.fitting.problem import Problem
from core.fitting.schedule import Schedule
from core.fitting.search import SearchResult, log_ratio, optimise, score, with_runner_up
from core.fitting.steps import SearchState

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
    alone: Problem  # of the unknown photo
    starts: HypothesisBatch  # initial hypotheses of the unknown photo
    result: SearchResult

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


def find_assignments(
    problem: Problem, singles: Sequence[SingleFit], schedule: Schedule, generator: torch.Generator
) -> Generator[SearchState, None, list[Assignment]]:
    """Return an assignment for every anchor; yield the state after each step.

    Args:
        problem: of all photos.
        singles: one fit of each photo with an unknown camera.
    """
    assignments = []
    for single in singles:
        for anchor in single.anchors:
            cameras = {tuple(single.views): anchor}
            for other in singles:
                if other is not single:
                    placed = yield from _place(other, anchor.parameters, schedule, generator)
                    cameras[other.views[-1:]] = placed.best
            assignments.append(_merge(single.views[-1], anchor, cameras, len(problem.photos)))
    return assignments


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
        view = single.views[-1]
        if problem.unknown[view]:
            codes = [one_view(winner.parameters, view), one_view(single.result.winner.parameters, -1)]
            common, own = (score(single.alone, HypothesisBatch.of(parameters), math.inf).loss for parameters in codes)
            excess[view] = log_ratio(common, own)
    if max(excess.values()) < _MISFIT and sum(excess.values()) < _DISAGREEMENT * len(excess):
        return None
    return max(excess) if int(problem.included.sum()) == 2 else max(excess, key=lambda number: excess[number])


def view_margins(
    problem: Problem,
    singles: Sequence[SingleFit],
    winner: HypothesisBatch,
    schedule: Schedule,
    generator: torch.Generator,
) -> Generator[SearchState, None, tuple[float | None, ...]]:
    """Return the margin of each photo's camera for the codes of the winner; yield the state after each step.

    None for known cameras and photos that are left out.
    """
    margins: list[float | None] = [None] * len(problem.photos)
    for single in singles:
        view = single.views[-1]
        if problem.included[view]:
            rivals = yield from _place(single, winner.parameters, schedule, generator)
            camera = HypothesisBatch.of(one_view(winner.parameters, view))
            camera = score(single.alone, camera, schedule.final.robust_scale)
            margins[view] = min(with_runner_up(single.alone, camera, rivals).margin, _LARGEST_MARGIN)
    return tuple(margins)


def _place(
    single: SingleFit, codes: Parameters, schedule: Schedule, generator: torch.Generator
) -> Generator[SearchState, None, HypothesisBatch]:
    """Return the best cameras of a photo for the codes of a single hypothesis, with their losses."""
    count = len(single.starts)
    shape = codes.shape.expand(count, -1)
    texture = codes.texture.expand(count, -1)
    starts = replace(single.starts, parameters=single.starts.parameters._replace(shape=shape, texture=texture))
    batch = starts
    for batch in optimise(single.alone, starts, schedule.placing, generator):
        yield SearchState(single.alone, single.views[-1:], batch)
    return score(single.alone, batch, schedule.final.robust_scale)


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
    angles, distance, zoom, crop_transform = merged
    cameras_of_all = anchor.parameters._replace(
        angles=angles, distance=distance, zoom=zoom, crop_transform=crop_transform
    )
    return Assignment(number, replace(anchor, parameters=cameras_of_all), losses)
