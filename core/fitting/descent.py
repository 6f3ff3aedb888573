"""Descent of hypotheses: optimise and prune in stages, score, select, refine.

Hypotheses descend together by :mod:`core.fitting.gauss_newton` in the stages of :mod:`core.fitting.schedule`, with
pruning between stages.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from core.fitting.biases import hypothesis_cells
from core.fitting.gauss_newton import gauss_newton_step, normal_equations
from core.fitting.hypotheses import HypothesisBatch, by_loss, concatenate, mean_parameters
from core.fitting.imagined import ImaginedViews, add_imagined, imagined_error
from core.fitting.objective import evaluate_objective, viewpoint_weights
from core.fitting.observations import sample_pixels
from core.fitting.problem import Problem
from core.fitting.schedule import Stage

_LOSS_FLOOR = 1e-6  # floor of the loss before the logarithm of ratios
_EMA = 0.4  # weight of a step's loss in the running mean for pruning
_WINDOW = 4  # steps of the refinement averaged for a score, as single steps overfit their pixels
_MIN_SAMPLES_FOR_CELLS = 60_000  # samples of a stage from which a shape's cells are computed
_SAMPLES_BETWEEN_UPDATES = 100_000  # samples after which the cells are recomputed


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
            equations = normal_equations(
                problem.model, batch.parameters, pixels, jitter, stage, objective, cells, problem.origin
            )
            if problem.imagined:
                view = ImaginedViews.random(problem.model, 1, stage.rays // 2, generator)
                add_imagined(equations, problem.model, batch.parameters, view, stage, cells, problem.origin)
            moved = gauss_newton_step(batch, equations, stage, problem.free)
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
        loss = value.objective
        if problem.imagined:
            loss = loss + imagined_error(
                problem.model, batch.parameters, problem.imagined, problem.settings.samples, cells, problem.origin
            )
    loss = loss.nan_to_num(math.inf, math.inf) * viewpoint_weights(batch.parameters, problem.viewpoints)
    return replace(batch, loss=loss, squared_error=value.squared_error)


def select(problem: Problem, batch: HypothesisBatch, coarse: HypothesisBatch, final: Stage) -> HypothesisBatch:
    """Return the best by score of the batch, its coarse ancestors and the coarse winner."""
    ancestors = torch.isin(coarse.origin, batch.origin)
    ancestors[coarse.leader] = True
    candidates = concatenate(batch, coarse[ancestors.nonzero()[:, 0]])
    return score(problem, candidates, final.robust_scale).best


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


def log_ratio(loss: Float[Tensor, "1"], reference: Float[Tensor, "1"]) -> float:
    """Return the logarithm of the ratio of two losses."""
    return math.log(max(float(loss), _LOSS_FLOOR) / max(float(reference), _LOSS_FLOOR))
