"""Cameras of several photos of one object: the object of one photo places the other photos.

Each photo is fitted alone. From its object, and from its runner-up's, the cameras of the other photos are searched with
constant codes. A camera that no single photo gives away is plain once the object is known, and the sum of the losses
tells right anchors from wrong ones.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import torch

from core.fitting.hypotheses import HypothesisBatch, Parameters, concatenate, other_basins
from core.fitting.problem import Problem
from core.fitting.schedule import Schedule
from core.fitting.search import SearchResult, optimise, score
from core.fitting.steps import SearchState


@dataclass(frozen=True, eq=False)
class SingleFit:
    """The fit of one photo with an unknown camera, together with all photos of known cameras."""

    views: Sequence[int]  # photos of the fit, the unknown one last
    alone: Problem  # of the unknown photo
    starts: HypothesisBatch  # initial hypotheses of the unknown photo
    result: SearchResult

    @property
    def anchors(self) -> list[HypothesisBatch]:
        """The winner and its runner-up."""
        return [hypothesis for hypothesis in (self.result.winner, self.result.runner_up) if hypothesis]


def find_assignments(
    problem: Problem, singles: Sequence[SingleFit], schedule: Schedule, generator: torch.Generator
) -> Generator[SearchState, None, HypothesisBatch]:
    """Return the best different assignments of cameras to all photos; yield the state after each step.

    Every anchor gives an assignment with its codes. The loss is the sum over the photos.

    Args:
        problem: of all photos.
        singles: one fit of each photo with an unknown camera.
    """
    assignments = []
    for single in singles:
        for anchor in single.anchors:
            cameras = [(list(single.views), anchor)]
            for other in singles:
                if other is not single:
                    placed = yield from _place(other, anchor.parameters, schedule, generator)
                    cameras.append((list(other.views[-1:]), placed))
            assignments.append(_merge(anchor, cameras, len(problem.photos)))
    every = replace(concatenate(*assignments), origin=torch.arange(len(assignments)))
    different = concatenate(every.best, other_basins(every, every.best, problem.unknown))
    return different[torch.arange(min(len(different), schedule.local[0].hypotheses))]


def _place(
    single: SingleFit, codes: Parameters, schedule: Schedule, generator: torch.Generator
) -> Generator[SearchState, None, HypothesisBatch]:
    """Return the best camera of a photo for the codes of a single hypothesis, with its loss."""
    count = len(single.starts)
    shape = codes.shape.expand(count, -1)
    texture = codes.texture.expand(count, -1)
    starts = replace(single.starts, parameters=single.starts.parameters._replace(shape=shape, texture=texture))
    batch = starts
    for batch in optimise(single.alone, starts, schedule.placing, generator):
        yield SearchState(single.alone, single.views[-1:], batch)
    return score(single.alone, batch, schedule.final.robust_scale).best


def _merge(
    anchor: HypothesisBatch, cameras: Sequence[tuple[list[int], HypothesisBatch]], photos: int
) -> HypothesisBatch:
    """Return an assignment: an anchor's codes, the cameras of some photos each, and the total loss."""
    merged = [values.new_zeros(1, photos, *values.shape[2:]) for values in anchor.parameters[:4]]
    loss = torch.zeros(1)
    for views, batch in cameras:
        loss += batch.loss * len(views)
        for all_views, values in zip(merged, batch.parameters[:4], strict=True):
            all_views[:, views] = values
    return replace(anchor, parameters=Parameters(*merged, *anchor.parameters[4:]), loss=loss)
