"""Rivals of a fitted camera: hypotheses from all around the object, optimised once the winner is known.

Most wrong cameras have a better explanation elsewhere, above all at the opposite view. The search may have dropped it
early or never started there, so a margin over what the search left would depend on luck. Rivals start from the winner
turned to every other sector, with its codes and with the mean ones.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import torch

from core.fitting.descent import log_ratio, optimise, score
from core.fitting.hypotheses import HypothesisBatch, concatenate, other_basins, turn_azimuth
from core.fitting.problem import Problem
from core.fitting.schedule import RIVAL_SECTORS, Schedule

_SCORED = 2  # rivals whose losses are compared with the winner's
_CLEAR_MARGIN = 2.0  # over all rivals after a stage; later stages lower it by 0.5 on average, which changes no answer


def rival_hypotheses(problem: Problem, winner: HypothesisBatch) -> HypothesisBatch:
    """Return the winner turned to every other sector of azimuth, with its codes, then with the mean ones.

    Args:
        winner: a single hypothesis.
    """
    turns = (2 * math.pi * sector / RIVAL_SECTORS for sector in range(1, RIVAL_SECTORS))
    turned = concatenate(*(turn_azimuth(winner, turn, problem.unknown) for turn in turns))
    shape = torch.zeros_like(turned.parameters.shape)
    texture = torch.zeros_like(turned.parameters.texture)
    return concatenate(turned, replace(turned, parameters=turned.parameters._replace(shape=shape, texture=texture)))


def optimise_rivals(
    problem: Problem, winner: HypothesisBatch, schedule: Schedule, generator: torch.Generator
) -> Iterator[HypothesisBatch]:
    """Yield the rivals of a winner after each step; last, the best of other basins with comparable losses.

    Each stage begins with the best rivals of different basins. The stages end early if the margin is clear.

    Args:
        winner: a single hypothesis, with the loss of :func:`core.fitting.descent.score`.
    """
    rivals = rival_hypotheses(problem, winner)
    scored = turn_azimuth(winner, math.pi, problem.unknown)  # if all rivals find the winner's camera
    for stage in schedule.rivals:
        for optimised in optimise(problem, rivals, (stage,), generator):
            yield optimised
        rivals = other_basins(optimised, winner, problem.unknown)
        if not len(rivals):
            break
        scored = rivals[torch.arange(min(_SCORED, len(rivals)))]
        scored = score(problem, scored, schedule.final.robust_scale)
        if log_ratio(scored.best.loss, winner.loss) > _CLEAR_MARGIN:
            break
    yield score(problem, scored, schedule.final.robust_scale)
