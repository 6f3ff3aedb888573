"""The free stage of a fit: after the codes are found, every bias of the field is free.

A code of 64 numbers enters the network as some 300 biases, so codes reach only a thin surface in the space of biases.
Offsets from that surface are found like codes, by Gauss-Newton steps on the photos; their prior is normal, with the
spread of the biases over the training codes. Of a symmetric object, every second
pixel shows the mirror image instead. GAN inversion
leaves its latent space in the same way (R. Abdal et al., "Image2StyleGAN", ICCV 2019; D. Roich et al., "Pivotal tuning
for latent-based editing of real images", 2021). Density still cannot see texture.
"""

from collections.abc import Iterator
from dataclasses import replace

import torch

from core.fitting.hypotheses import HypothesisBatch
from core.fitting.problem import Problem
from core.fitting.schedule import Stage
from core.fitting.search import refine, score
from core.models.latents import Latents

_ASYMMETRIC = 4.0  # squared error of a mirror image, relative to the object's own, from which it is not used


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
    problem = replace(problem, origin=origin, mirrored=is_symmetric(problem, winner, stage))
    for best in refine(problem, freed, stage, generator):
        yield origin, best


def is_symmetric(problem: Problem, winner: HypothesisBatch, stage: Stage) -> bool:
    """Return whether the photos explain the winner's mirror image nearly as well as the winner."""
    mirrored = replace(problem, scoring=problem.scoring._replace(mirrored=True))  # half of the pixels
    plain, half = (score(each, winner, stage.robust_scale).squared_error for each in (problem, mirrored))
    return bool(half < (1 + _ASYMMETRIC) / 2 * plain)
