"""The free stage of a fit: after the codes are found, every bias of the field is free, then its weights.

A code of 64 numbers enters the network as some 300 biases, so codes reach only a thin surface in the space of biases.
Offsets from that surface are found like codes, by Gauss-Newton steps on the photos. Their prior is normal, with the
spread of the biases over the training codes (:mod:`core.fitting.biases`). GAN inversion leaves its latent space in the
same way (R. Abdal et al., "Image2StyleGAN", ICCV 2019; D. Roich et al., "Pivotal tuning for latent-based editing of
real images", 2021). Density still cannot see texture. Photos of several sides go on to :mod:`core.fitting.network`.
"""

from collections.abc import Iterator
from dataclasses import replace

import torch

from core.fitting.descent import refine, score
from core.fitting.hypotheses import HypothesisBatch, one_view
from core.fitting.imagined import ImaginedViews
from core.fitting.network import free_network, frees_network
from core.fitting.objective import render_pixels
from core.fitting.observations import Observation, sample_pixels
from core.fitting.problem import SCORING_RAYS, Problem
from core.fitting.schedule import Stage
from core.models.latents import Latents

_CAUTION = 10.0  # times the prior's weight where the object comes from a photograph
_SOLID = 0.7  # opacity of codes above which they hold a background pixel of a doubtful mask for the object
_VIEWS = 8  # imagined ones, to compare hypotheses on


def free_steps(problem: Problem, winner: HypothesisBatch, stage: Stage) -> int:
    """Return the number of steps of :func:`free_object`."""
    return 2 * stage.steps if frees_network(problem, winner) else stage.steps


def free_object(
    problem: Problem, winner: HypothesisBatch, stage: Stage, generator: torch.Generator
) -> Iterator[tuple[Latents, HypothesisBatch]]:
    """Free the biases, then the network if the photos determine it.

    Yields the winner's codes and the best hypothesis around them so far, after each step. Codes with a network have its
    offsets.

    Args:
        winner: result of the search, a single hypothesis.
        stage: :attr:`core.fitting.schedule.Schedule.free`.
    """
    frees_all = frees_network(problem, winner)
    # Photos of several sides tell light and gloss from shape.
    if any(photo.mask_confidence < 1 or (photo.cropped and not frees_all) for photo in problem.photos):
        problem = _cautious(problem, winner, generator)
    for origin, freed in _free_biases(problem, winner, stage, generator):
        yield origin, freed
    if frees_all:
        yield from free_network(problem, origin, freed, stage, generator)


def _free_biases(
    problem: Problem, winner: HypothesisBatch, stage: Stage, generator: torch.Generator
) -> Iterator[tuple[Latents, HypothesisBatch]]:
    parameters = winner.parameters
    shapes, textures = problem.spaces
    origin = Latents(shapes.code(parameters.shape[0]), textures.code(parameters.texture[0]))
    shape, texture = (torch.zeros(1, std.numel()) for std in problem.model.bias_std)
    problem = replace(problem, origin=origin)
    start = replace(winner, parameters=parameters._replace(shape=shape, texture=texture))
    start = score(problem, start, stage.robust_scale)  # by this objective, whose prior is of the offsets
    for best in refine(problem, start, stage, generator):
        yield origin, best


def _cautious(problem: Problem, winner: HypothesisBatch, generator: torch.Generator) -> Problem:
    """Return the problem of objects of photographs, which are trusted less than renders of a known size.

    Free biases would explain light, gloss and errors of the mask by shape, so the prior weighs more. Doubtful masks add
    to the object, but carve nothing that its codes hold solid: a gap may be a mistake. The sides that no photo shows
    are imagined (:mod:`core.fitting.imagined`).
    """
    observations = tuple(
        observation if photo.mask_confidence == 1 else _without_solid(problem, winner, observation, view)
        for view, (observation, photo) in enumerate(zip(problem.observations, problem.photos, strict=True))
    )
    scoring = sample_pixels(observations, max(1, SCORING_RAYS // len(observations)), generator)
    settings = replace(problem.settings, code_prior=_CAUTION * problem.settings.code_prior)
    imagined = ImaginedViews.random(problem.model, _VIEWS, SCORING_RAYS // (2 * _VIEWS), generator)
    return replace(problem, observations=observations, scoring=scoring, settings=settings, imagined=imagined)


def _without_solid(problem: Problem, winner: HypothesisBatch, observation: Observation, view: int) -> Observation:
    """Return a photo's observation without certainty of background that the winner covers."""
    background = (observation.target_opacity < 0.5).nonzero()[:, 0]
    parameters = one_view(winner.parameters, view)
    with torch.no_grad():
        pixels = observation.batch(background)
        opacity = render_pixels(problem.model, parameters, pixels, problem.settings.samples).opacity
    certainty = observation.certainty.clone()
    certainty[background[opacity[0, 0] > _SOLID]] = 0.0
    return replace(observation, certainty=certainty)
