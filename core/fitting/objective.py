"""The objective of a fit: every loss term, each as a value and as the weighted residuals that Gauss-Newton uses.

A term is a sum of functions of squared residuals. Where such a function is not the identity (Cauchy's loss, the camera
prior), Gauss-Newton sees it as iteratively reweighted least squares does: each squared residual weighted by the
function's derivative there, so that the weighted sum has the gradient of the value. A new term is one function that
returns a :class:`Term`, listed in :func:`image_terms` or :func:`prior_terms`: all else adds up what is listed there.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.hypotheses import CAMERA_PARAMETERS, Parameters, hypothesis_rays, known_cells
from core.fitting.observations import PixelBatch
from core.models.model import Model
from core.models.precision import autocast
from core.models.viewpoint import direction_weights, viewpoint_nll
from core.rendering.importance import render_top_samples

MASK_WEIGHT = 0.1
"""The squared error of opacity against that of colour."""
CAMERA_PRIOR_SCALE = (0.2, 0.02, 0.3, 0.02, 0.03, 0.01, 0.01)
"""How far a camera moves before it costs much: rad below the ground's level, the logarithm of the distance away from
that of the training images, which all have one, that of the focal length, and of :attr:`Parameters.picture`."""
OCCLUDER_SCALE = 0.2
"""As :attr:`Objective.occluder_scale`, once it is doubted that the object is seen as a whole."""
MOVED_SCALE = 0.05
"""Of the scale, for a photo that was moved before it was fitted."""
SCALED_SCALE = 0.15
"""The same where the photo was scaled, against the scale that objects have on average when seen from there."""
CAMERA_PRIOR_WEIGHT = (2e-3, 2e-3, 2e-4, 2e-3, 2e-3, 2e-3, 2e-3)
"""Against the squared error of a pixel; grows with the logarithm only, so that a photo can insist."""
_VIEWPOINT_WEIGHT = 0.15
"""Of a camera's negative log-likelihood, against the logarithm of the objective; chosen on 15 held-out chairs."""
COLOUR, OPACITY = slice(0, 3), slice(3, 4)
"""Channels of a render, as Gauss-Newton differentiates them."""
_PRIOR_COLUMNS = slice(1, CAMERA_PARAMETERS)
"""The parameters of a camera that its prior is about: all but the azimuth."""


class Objective(NamedTuple):
    """The weights and scales of all terms."""

    code_prior: float
    """of a squared standard deviation of a code, against a squared error"""
    camera_scale: Float[Tensor, "#views 7"] = torch.tensor([CAMERA_PRIOR_SCALE])
    """of :func:`camera_residuals`; infinite where a camera is given, or says nothing"""
    camera_weight: Float[Tensor, "7"] = torch.tensor(CAMERA_PRIOR_WEIGHT)
    expected_scale: Float[Tensor, "views directions"] | None = None
    """of photos (logarithm), from the directions of :func:`core.models.viewpoint.directions`; None: all 0"""
    mask_weight: float = MASK_WEIGHT
    """0 where the network itself paints the background, which makes all rays opaque"""
    robust_scale: float = math.inf
    """A colour error of this size (root mean square over the channels) pulls half as hard as in Eq. 5: there is
    something that the model cannot render."""
    occluder_scale: float = math.inf
    """The same for colours and opacity beside the object, where something in front may hide more of it."""


class ObjectiveValue(NamedTuple):
    """How well hypotheses explain some pixels."""

    objective: Float[Tensor, "hypotheses"]
    squared_error: Float[Tensor, "hypotheses"]
    """the mean squared error per channel over whole photos, as estimated from these pixels"""


class Term(NamedTuple):
    """A loss term of many hypotheses."""

    value: Float[Tensor, "hypotheses"]
    residual: Float[Tensor, "hypotheses *residuals"]
    weight: Float[Tensor, "hypotheses *residuals"]
    """the derivative of the value along each squared residual"""
    of: slice
    """which channels of a render (red, green, blue, opacity) its residuals belong to; of a prior, which parameters"""


def evaluate_objective(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int,
    objective: Objective,
    jitter: Tensor | None = None,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
) -> ObjectiveValue:
    """The objective of every hypothesis over some pixels: Eq. 5 with robust errors, a mask and priors; differentiable.

    Args:
        jitter: as for :func:`core.fitting.hypotheses.hypothesis_rays`.
        cells: those that the shapes may occupy, where known better than ``model.occupied_cells``.
    """
    codes = model.codes.shape_space.code(parameters.shape), model.codes.texture_space.code(parameters.texture)
    colour, opacity = _render(model, parameters, codes, pixels, samples, jitter, cells)
    terms = (*image_terms(colour, opacity, pixels, objective), *prior_terms(parameters, objective))
    value = torch.stack([term.value for term in terms]).sum(0)
    error = image_squared_error(colour, opacity, pixels, objective.occluder_scale)
    return ObjectiveValue(value, error.detach())


def paper_objective(
    model: Model, parameters: Parameters, pixels: PixelBatch, samples: int, code_prior: float, jitter: Tensor | None
) -> ObjectiveValue:
    """Eq. 5 as it stands, differentiable: the error over the whole image and the codes' squared norms.

    Args:
        parameters: whose shape and texture are the codes themselves.
    """
    colour, opacity = _render(model, parameters, (parameters.shape, parameters.texture), pixels, samples, jitter)
    error = image_squared_error(colour, opacity, pixels)
    priors = [code_prior_term(code, code_prior).value for code in (parameters.shape, parameters.texture)]
    return ObjectiveValue(error + sum(priors), error.detach())


def image_squared_error(
    colour: Tensor, opacity: Tensor, pixels: PixelBatch, occluder_scale: float = math.inf
) -> Float[Tensor, "hypotheses"]:
    """The mean squared error per channel over whole photos, as estimated from some of their pixels.

    What something in front may hide counts as little as it does in the objective.
    """
    _, seen = cauchy_loss((opacity - pixels.target_opacity).square(), _scales(pixels, math.inf, occluder_scale))
    squared = seen * (colour - pixels.colours).square().mean(-1)
    return (squared * pixels.weights).sum((1, 2)) / squared.shape[1]


def image_terms(colour: Tensor, opacity: Tensor, pixels: PixelBatch, objective: Objective) -> tuple[Term, ...]:
    """The terms of rendered pixels: of their colours, of their opacity; a residual per channel."""
    return photometric_term(colour, pixels, objective), mask_term(opacity, pixels, objective)


def prior_terms(parameters: Parameters, objective: Objective) -> tuple[Term, ...]:
    """The terms of the parameters alone: of the cameras, of shape and of texture. Their Jacobian is the identity."""
    views, ranks = parameters.distance.shape[1], parameters.shape.shape[1]
    cameras, end = slice(views * CAMERA_PARAMETERS), views * CAMERA_PARAMETERS + ranks
    return (
        camera_prior_term(parameters, objective)._replace(of=cameras),
        code_prior_term(parameters.shape, objective.code_prior)._replace(of=slice(cameras.stop, end)),
        code_prior_term(parameters.texture, objective.code_prior)._replace(of=slice(end, None)),
    )


def photometric_term(colour: Tensor, pixels: PixelBatch, objective: Objective) -> Term:
    """Errors of colours, averaged over channels, pixels and views; robust by Cauchy's loss."""
    error = colour - pixels.colours
    beside = min(objective.robust_scale, objective.occluder_scale)
    loss, weight = cauchy_loss(error.square().mean(-1), _scales(pixels, objective.robust_scale, beside))
    weight = (weight * pixels.certainty / error[0].numel())[..., None].expand_as(error)
    return Term((loss * pixels.certainty).mean((1, 2)), error, weight, COLOUR)


def mask_term(opacity: Tensor, pixels: PixelBatch, objective: Objective) -> Term:
    """Errors of opacity where the mask is known, averaged over pixels and views."""
    error = opacity - pixels.target_opacity
    loss, weight = cauchy_loss(error.square(), _scales(pixels, math.inf, objective.occluder_scale))
    each = objective.mask_weight * pixels.mask_valid * pixels.certainty / error[0].numel()
    return Term((each * loss).sum((1, 2)), error[..., None], (each * weight)[..., None], OPACITY)


def code_prior_term(code: Float[Tensor, "hypotheses rank"], code_prior: float) -> Term:
    """The squared length of a code, in standard deviations."""
    return Term(code_prior * code.square().sum(-1), code, torch.full_like(code, code_prior), slice(None))


def camera_prior_term(parameters: Parameters, objective: Objective) -> Term:
    """Unlikely cameras, averaged over views; residuals are (hypotheses, views, 8), one per camera parameter.

    It grows with a logarithm. A camera that it does not move has no weight, so that it does not hold it either.
    """
    distance = camera_residuals(parameters, objective.expected_scale)
    scaled = (distance / objective.camera_scale).square()
    value = (scaled.log1p() * objective.camera_weight).sum(-1).mean(-1)
    slope = objective.camera_weight / objective.camera_scale**2 / (1 + scaled) / distance.shape[1]
    residual, weight = (distance.new_zeros(*distance.shape[:2], CAMERA_PARAMETERS) for _ in range(2))
    residual[..., _PRIOR_COLUMNS], weight[..., _PRIOR_COLUMNS] = distance, slope * (distance != 0)
    return Term(value, residual, weight, slice(None))


def cauchy_loss(squared: Tensor, scale: Float[Tensor, "*#squared"]) -> tuple[Tensor, Tensor]:
    """Cauchy's loss of squared residuals, and its derivative: far beyond the scale it grows with the logarithm."""
    robust = scale.isfinite()
    unit = scale.square().where(robust, torch.ones_like(scale))
    ratio = squared / unit
    return (unit * ratio.log1p()).where(robust, squared), (1 / (1 + ratio)).where(robust, torch.ones_like(ratio))


def _scales(pixels: PixelBatch, on_object: float, beside: float) -> Float[Tensor, "views rays"]:
    """A scale for the pixels of the object, another for the rest."""
    scale = torch.full_like(pixels.target_opacity, on_object)
    return scale.masked_fill(pixels.target_opacity < 0.5, beside)


def camera_residuals(
    parameters: Parameters, expected_scale: Float[Tensor, "views directions"] | None = None
) -> Float[Tensor, "hypotheses views 7"]:
    """How far cameras are below the ground's level (rad, at most 0), away from the usual distance and focal length
    (logarithms), and how far photos are from showing what they see as it is, or at the scale that is expected.
    """
    (azimuth, elevation), scale = parameters.angles.unbind(-1), parameters.picture[..., 0]
    if expected_scale is not None:  # of the directions as they are: a step sees it as constant
        scale = scale - (direction_weights(azimuth, elevation) * expected_scale).sum(-1).detach()
    first = elevation.clamp_max(0), parameters.distance, parameters.zoom, scale
    return torch.cat((torch.stack(first, -1), parameters.picture[..., 1:]), -1)


def viewpoint_weights(
    parameters: Parameters, probabilities: Sequence[Float[Tensor, "directions"] | None]
) -> Float[Tensor, "hypotheses"]:
    """What the losses of hypotheses are multiplied by: at least 1, the more the less likely their viewpoints are.

    Args:
        probabilities: of every view, as :func:`core.models.viewpoint.predict_viewpoint` has them, or None.
    """
    nll = torch.zeros(len(parameters.angles))
    for probability, angles in zip(probabilities, parameters.angles.unbind(1), strict=True):
        if probability is not None:
            nll += viewpoint_nll(probability, *angles.unbind(-1))
    return (_VIEWPOINT_WEIGHT * nll).exp()


def _render(
    model: Model,
    parameters: Parameters,
    codes: tuple[Tensor, Tensor],
    pixels: PixelBatch,
    samples: int,
    jitter: Tensor | None,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
) -> tuple[Float[Tensor, "hypotheses views rays 3"], Float[Tensor, "hypotheses views rays"]]:
    rays = hypothesis_rays(model, parameters, pixels, samples, jitter)
    biases = model.field.biases(*codes)
    cells = known_cells(model, cells)
    with autocast(model.device):
        colour, opacity = render_top_samples(model, rays, samples, max(2, samples // 6), *biases, cells)
    return pixels.mean_of_rays(colour.cpu()), pixels.mean_of_rays(opacity.cpu())
