"""The steps of a multi-start search for cameras and codes: optimise, prune, select, refine, assess.

Hypotheses descend together by :mod:`core.fitting.gauss_newton` in the stages of :mod:`core.fitting.schedule`, with
pruning between stages. :mod:`core.fitting.rivals` then looks for a better camera elsewhere.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.fitting.biases import hypothesis_cells
from core.fitting.confidence import confidence
from core.fitting.gauss_newton import camera_uncertainty, gauss_newton_step
from core.fitting.hypotheses import (
    HypothesisBatch,
    by_loss,
    concatenate,
    mean_parameters,
    other_basins,
)
from core.fitting.objective import evaluate_objective, viewpoint_weights
from core.fitting.observations import sample_pixels
from core.fitting.problem import Problem
from core.fitting.schedule import Stage

_LOSS_FLOOR = 1e-6  # floor of the loss before the logarithm of ratios
_EMA = 0.4  # weight of a step's loss in the running mean for pruning
_WINDOW = 4  # steps of the refinement averaged for a score, as single steps overfit their pixels
_MIN_SAMPLES_FOR_CELLS = 60_000  # samples of a stage from which a shape's cells are computed
_SAMPLES_BETWEEN_UPDATES = 100_000  # samples after which the cells are recomputed
RESTART_BELOW = 0.65  # confidence of a camera below which the search restarts; belongs to CALIBRATION


class SearchResult(NamedTuple):
    """The winner of a search, and the assessment of its camera."""

    winner: HypothesisBatch  # a single one
    runner_up: HypothesisBatch | None = None  # best hypothesis of another basin, if one camera is unknown
    margin: float = math.inf  # log ratio of the runner-up's loss to the winner's
    uncertainty: float | None = None  # degrees, once assessed, if a camera is searched
    view_margins: tuple[float | None, ...] = ()  # of each camera among several, for constant codes


def optimise(
    problem: Problem, batch: HypothesisBatch, stages: Sequence[Stage], generator: torch.Generator
) -> Iterator[HypothesisBatch]:
    """Yield all hypotheses after each step of some stages, pruned before each stage; losses are running means."""
    for stage in stages:
        batch = batch if len(batch) <= stage.hypotheses else batch[by_loss(batch)[: stage.hypotheses]]
        objective = problem.objective(stage.robust_scale)
        cells = None
        samples_per_step = len(problem.photos) * stage.rays * stage.samples
        update_every = max(_WINDOW, _SAMPLES_BETWEEN_UPDATES // samples_per_step)
        use_cells = stage.steps * samples_per_step > _MIN_SAMPLES_FOR_CELLS
        for step in range(stage.steps):
            if step % update_every == 0 and use_cells:
                cells = hypothesis_cells(problem.model, batch.parameters, problem.origin)
            pixels = sample_pixels(problem.observations, stage.rays, generator)
            jitter = torch.rand(pixels.points.shape[:2], generator=generator) - 0.5
            moved = gauss_newton_step(
                problem.model, batch, pixels, jitter, stage, objective, problem.free, cells, problem.origin
            )
            loss = moved.loss * viewpoint_weights(moved.parameters, problem.viewpoints)
            loss = torch.lerp(batch.loss, loss, _EMA if step else 1.0).nan_to_num(math.inf, math.inf)
            batch = replace(moved, loss=loss)
            yield batch


def score(problem: Problem, batch: HypothesisBatch, robust_scale: float) -> HypothesisBatch:
    """Return the hypotheses with their losses on the common scoring pixels."""
    objective = problem.objective(robust_scale)
    with torch.no_grad():
        cells = hypothesis_cells(problem.model, batch.parameters, problem.origin)
        value = evaluate_objective(
            problem.model,
            batch.parameters,
            problem.scoring,
            problem.settings.samples,
            objective,
            cells=cells,
            origin=problem.origin,
        )
    loss = value.objective.nan_to_num(math.inf, math.inf) * viewpoint_weights(batch.parameters, problem.viewpoints)
    return replace(batch, loss=loss, squared_error=value.squared_error)


def select(problem: Problem, batch: HypothesisBatch, coarse: HypothesisBatch, final: Stage) -> HypothesisBatch:
    """Return the best by score of the batch, its coarse ancestors and the coarse winner."""
    ancestors = torch.isin(coarse.origin, batch.origin)
    ancestors[coarse.leader] = True
    candidates = concatenate(batch, coarse[ancestors.nonzero()[:, 0]])
    return score(problem, candidates, final.robust_scale).best


def with_runner_up(problem: Problem, winner: HypothesisBatch, candidates: HypothesisBatch) -> SearchResult:
    """Pair the winner with the best of the candidates that lie in another basin, if any."""
    rivals = other_basins(candidates, winner, problem.unknown)
    if not len(rivals):
        return SearchResult(winner)
    return SearchResult(winner, rivals.best, log_ratio(rivals.best.loss, winner.loss))


def log_ratio(loss: Float[Tensor, "1"], reference: Float[Tensor, "1"]) -> float:
    """Return the logarithm of the ratio of two losses."""
    return math.log(max(float(loss), _LOSS_FLOOR) / max(float(reference), _LOSS_FLOOR))


def refine(
    problem: Problem, winner: HypothesisBatch, final: Stage, generator: torch.Generator
) -> Iterator[HypothesisBatch]:
    """Yield after each step the best so far: the winner or a mean over recent steps."""
    best = winner
    recent = list[HypothesisBatch]()
    for step, moved in enumerate(optimise(problem, winner, (final,), generator), 1):
        recent = [*recent, moved][-_WINDOW:]
        if step % _WINDOW == 0 or step == final.steps:
            best = concatenate(best, score(problem, mean_parameters(recent), final.robust_scale)).best
        yield best


def assess(problem: Problem, result: SearchResult, final: Stage) -> SearchResult:
    """Add the uncertainty of unknown cameras to the result, from pixels that were not fitted."""
    if not bool(problem.unknown.any()):
        return result
    inputs = problem.validation, final, problem.objective(final.robust_scale), problem.free, problem.unknown
    return result._replace(uncertainty=math.degrees(camera_uncertainty(problem.model, result.winner, *inputs)))


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
