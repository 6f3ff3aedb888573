"""Imagined views: what random cameras see of an object is pulled to a surface or to nothing.

A photo says nothing of the sides that it does not show, where free biases leave haze, crumbs and torn surfaces. Real
objects are opaque: every ray of a random camera ends on a surface or passes by. The target of each pixel is the nearer
of the two by its own render, opacity 1 and the surface's colour, or opacity 0 and white. S. Lombardi et al. ("Neural
volumes", SIGGRAPH 2019) ask for such opacities in the views of their photos.
"""

import math
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.gauss_newton import NormalEquations, normal_equations
from core.fitting.hypotheses import CAMERA_PARAMETERS, Parameters
from core.fitting.objective import Objective, RenderedPixels, Term, evaluate_objective
from core.fitting.observations import PixelBatch
from core.fitting.schedule import Stage
from core.models.latents import Latents
from core.models.model import Model

_HIGHEST = math.radians(45)  # elevation of cameras
_HALF_WIDTH = 0.5  # of a view, scene units at the depth of the object's middle
_SURFACE = 0.4
"""Opacity above which a pixel shows a surface. At a half, thin parts such as a chair's stem were lost; at 0.3, gaps
between rods were closed."""


class ImaginedViews(NamedTuple):
    """Random cameras, and pixels of their images."""

    angles: Float[Tensor, "views 2"]  # azimuth, elevation; rad
    pixels: PixelBatch  # without targets

    @classmethod
    def random(cls, model: Model, views: int, rays: int, generator: torch.Generator) -> "ImaginedViews":
        """Return views from around the object, of ``rays`` pixels each."""
        turns, heights = torch.rand(2, views, generator=generator)
        points = (2 * torch.rand(views, rays, 2, generator=generator) - 1) * (_HALF_WIDTH / model.distance)
        zeros = torch.zeros(views, rays)
        ones = torch.ones(views, rays)
        pixels = PixelBatch(
            points, torch.zeros(views, rays, 3), zeros, ones, ones, torch.zeros(views, rays, 1, 2), ones / rays
        )
        return cls(torch.stack((2 * math.pi * turns, _HIGHEST * heights), -1), pixels)

    def seeing(self, parameters: Parameters) -> Parameters:
        """Return hypotheses with these cameras instead of those of the photos."""
        hypotheses = len(parameters.angles)
        angles = self.angles.expand(hypotheses, -1, -1)
        zeros = torch.zeros(angles.shape[:2])
        crop_transform = torch.zeros(*angles.shape[:2], 4)
        return Parameters(angles, zeros, zeros, crop_transform, parameters.shape, parameters.texture)


def add_imagined(
    equations: NormalEquations,
    model: Model,
    parameters: Parameters,
    views: ImaginedViews,
    stage: Stage,
    cells: Bool[Tensor, "hypotheses x y z"] | None,
    origin: Latents | None,
) -> None:
    """Add the errors of imagined views to the equations of the codes, in place.

    Args:
        equations: around the parameters; other arguments as in :func:`core.fitting.gauss_newton.normal_equations`.
    """
    added = normal_equations(model, views.seeing(parameters), views.pixels, None, stage, _OBJECTIVE, cells, origin)
    cameras = CAMERA_PARAMETERS * len(views.angles)
    codes = added.gradient.shape[1] - cameras
    equations.objective.add_(added.objective)
    equations.gradient[:, -codes:] += added.gradient[:, cameras:]
    equations.hessian[:, -codes:, -codes:] += added.hessian[:, cameras:, cameras:]


def imagined_error(
    model: Model,
    parameters: Parameters,
    views: ImaginedViews,
    samples: int,
    cells: Bool[Tensor, "hypotheses x y z"] | None,
    origin: Latents | None,
) -> Float[Tensor, "hypotheses"]:
    """Return the objective of imagined views; arguments as in :func:`core.fitting.objective.evaluate_objective`."""
    imagined = views.seeing(parameters)
    return evaluate_objective(model, imagined, views.pixels, samples, _OBJECTIVE, cells, origin).objective


def _colour_term(pixels: PixelBatch, objective: Objective) -> Term:
    """Return the term of colours between a surface and white, averaged over pixels and views."""

    def residual(_: Parameters, rendered: RenderedPixels) -> Tensor:
        opacity = rendered.opacity[..., None]
        surface = 1 + (rendered.colour - 1) / opacity.clamp_min(_SURFACE)
        return rendered.colour - surface.where(opacity > _SURFACE, 1.0).detach()

    return Term(residual, 1 / pixels.certainty.numel(), channels=slice(0, 3))


def _opacity_term(pixels: PixelBatch, objective: Objective) -> Term:
    """Return the term of opacities between 0 and 1, averaged over pixels and views."""

    def residual(_: Parameters, rendered: RenderedPixels) -> Tensor:
        return (rendered.opacity - (rendered.opacity > _SURFACE).float())[..., None]

    return Term(residual, objective.mask_weight / pixels.certainty.numel(), channels=slice(3, 4))


_OBJECTIVE = Objective(0.0, terms=(_colour_term, _opacity_term))
