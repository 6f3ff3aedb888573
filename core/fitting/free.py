"""The free stage of a fit: after the codes are found, every bias of the field is free.

A code of 64 numbers enters the network as some 300 biases, so codes reach only a thin surface in the space of biases.
Offsets from that surface are found like codes, by Gauss-Newton steps on the photos. Their prior is normal, with the
covariance of the biases over the training codes (:mod:`core.fitting.biases`). GAN inversion leaves its latent space in
the same way (R. Abdal et al., "Image2StyleGAN", ICCV 2019; D. Roich et al., "Pivotal tuning for latent-based editing of
real images", 2021). Density still cannot see texture.
"""

from collections.abc import Iterator
from dataclasses import replace

import torch

from core.fitting.hypotheses import HypothesisBatch
from core.fitting.problem import Problem
from core.fitting.schedule import Stage
from core.fitting.search import refine
from core.models.latents import Latents


def free_biases(
    problem: Problem, winner: HypothesisBatch, stage: Stage, generator: torch.Generator
) -> Iterator[tuple[Latents, HypothesisBatch]]:
    """Yield the winner's codes and the best hypothesis of free biases around them so far, after each step.

    Args:
        winner: result of the search, a single hypothesis.
        stage: :attr:`core.fitting.schedule.Schedule.free`.
    """
    parameters, (shapes, textures) = winner.parameters, problem.spaces
    origin = Latents(shapes.code(parameters.shape[0]), textures.code(parameters.texture[0]))
    shape, texture = (torch.zeros(1, std.numel()) for std in problem.model.bias_std)
    freed = replace(winner, parameters=parameters._replace(shape=shape, texture=texture))
    # A mask that is not exact has holes and gaps where the codes are right: large errors beside it count little.
    exact = all(photo.mask_confidence == 1 for photo in problem.photos)
    problem = replace(problem, origin=origin, occluded=problem.occluded or not exact)
    for best in refine(problem, freed, stage, generator):
        yield origin, best
