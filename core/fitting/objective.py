"""The objective of a fit: a sum of loss terms, each a residual function, a weight and a scale of Cauchy's loss.

A term's value and its part of the Gauss-Newton equations (:mod:`core.fitting.gauss_newton`) follow from these. To
add a term, write a function that returns a :class:`Term` and list it in :data:`TERMS`.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.classifiers.viewpoint import direction_weights, viewpoint_nll
from core.fitting.biases import hypothesis_biases
from core.fitting.hypotheses import Parameters, hypothesis_rays, known_cells
from core.fitting.observations import PixelBatch
from core.fitting.pieces import Piece, cells_of, map_rays
from core.models.latents import Latents
from core.models.model import Model
from core.rendering.importance import render_top_samples
from core.runtime.precision import autocast

MASK_WEIGHT = 0.1  # of the squared error of opacity, relative to that of colour
CAMERA_PRIOR_SCALE = (0.2, 0.02, 0.3, 0.02, 0.03, 0.01, 0.01)
"""Scales of :func:`camera_residuals`: elevation (rad), log distance, log focal length, log scale of the crop, roll
(rad), shift right and down (focal lengths). The distance is tight, as all training images have the same."""
OCCLUDER_SCALE = 0.2  # :attr:`Objective.occluder_scale` if the object may be occluded
MOVED_SCALE = 0.05  # standard deviation of a recentred photo's log zoom
SCALED_SCALE = 0.15  # standard deviation of a scaled photo's log zoom around the mean of objects from that direction
CAMERA_PRIOR_WEIGHT = (2e-3, 2e-3, 2e-4, 2e-3, 2e-3, 2e-3, 2e-3)  # relative to a pixel's squared error
_VIEWPOINT_LOSS_WEIGHT = 0.15
"""Weight of a camera's negative log-likelihood relative to the log objective; chosen on 15 held-out chairs."""


class RenderedPixels(NamedTuple):
    """Pixels rendered by hypotheses."""

    channels: Float[Tensor, "hypotheses views rays channels"]

    @property
    def colour(self) -> Float[Tensor, "hypotheses views rays 3"]:
        """Red, green, blue on white."""
        return self.channels[..., :3]

    @property
    def opacity(self) -> Float[Tensor, "hypotheses views rays"]:
        """Opacity, 0..1."""
        return self.channels[..., 3]


class Term(NamedTuple):
    """A loss term: the sum over its items of weight times Cauchy's loss of the squared error."""

    residual: Callable[[Parameters, RenderedPixels], Float[Tensor, "hypotheses *items components"]]
    """The squared error of an item is the mean square of its components."""
    weight: Float[Tensor, "*#items"] | float  # of a pixel's item: divided by the number of pixels, for an average
    scale: Float[Tensor, "*#items"] | float = math.inf  # of Cauchy's loss; infinite: least squares
    channels: slice | None = None
    """channels of a rendered pixel (hypotheses, views, rays) of which the components are errors, with a derivative of
    1; None: each item depends on one parameter that no other item of the term uses"""


def term_value(term: Term, residual: Float[Tensor, "hypotheses *items components"]) -> Float[Tensor, "hypotheses"]:
    """Return the value of a term from its residuals."""
    return (term.weight * cauchy(residual.square().mean(-1), term.scale)).flatten(1).sum(1)


def residual_weights(
    term: Term, residual: Float[Tensor, "hypotheses *items components"]
) -> Float[Tensor, "hypotheses *items 1"]:
    """Return the weights of iteratively reweighted least squares.

    The sum of weighted squared residuals, with constant weights, has the gradient of the term's value.
    """
    return (term.weight * cauchy_slope(residual.square().mean(-1), term.scale))[..., None] / residual.shape[-1]


def cauchy(squared: Float[Tensor, "*items"], scale: Float[Tensor, "*#items"] | float) -> Float[Tensor, "*items"]:
    """Return Cauchy's loss of squared errors: quadratic far below a scale of the error, logarithmic far above it."""
    scale = torch.as_tensor(scale)
    robust = scale.isfinite()
    unit = scale.square().where(robust, 1.0)
    return (unit * (squared / unit).log1p()).where(robust, squared)


def cauchy_slope(squared: Float[Tensor, "*items"], scale: Float[Tensor, "*#items"] | float) -> Float[Tensor, "*items"]:
    """Return the derivative of :func:`cauchy` with respect to the squared error."""
    return 1 / (1 + squared / torch.as_tensor(scale).square())


def photometric_term(pixels: PixelBatch, objective: "Objective") -> Term:
    """Return the term of colour errors, averaged over pixels and views."""
    outside = min(objective.robust_scale, objective.occluder_scale)
    scale = _scales(pixels, objective.robust_scale, outside)
    weight = pixels.certainty / pixels.certainty.numel()
    return Term(lambda _, rendered: rendered.colour - pixels.colours, weight, scale, slice(0, 3))


def mask_term(pixels: PixelBatch, objective: "Objective") -> Term:
    """Return the term of opacity errors where the mask is known, averaged over pixels and views."""
    scale = _scales(pixels, math.inf, objective.occluder_scale)
    weight = objective.mask_weight * pixels.mask_valid * pixels.certainty / pixels.certainty.numel()
    return Term(lambda _, rendered: (rendered.opacity - pixels.target_opacity)[..., None], weight, scale, slice(3, 4))


def camera_prior_term(pixels: PixelBatch, objective: "Objective") -> Term:
    """Return the camera prior, averaged over views. It grows only logarithmically, so that a photo can override it."""

    def residual(parameters: Parameters, _: RenderedPixels) -> Tensor:
        distance = camera_residuals(parameters, objective.expected_scale) / objective.camera_scale
        return distance[..., None].where(distance[..., None] != 0, 0.0)  # residuals of zero add no curvature

    return Term(residual, objective.camera_weight / len(pixels.pixels), 1.0)


def code_prior_term(pixels: PixelBatch, objective: "Objective") -> Term:
    """Return the code prior: squared lengths of both codes, in standard deviations."""

    def residual(parameters: Parameters, _: RenderedPixels) -> Tensor:
        return torch.cat((parameters.shape, parameters.texture), 1)[..., None]

    return Term(residual, objective.code_prior)


TERMS = (photometric_term, mask_term, camera_prior_term, code_prior_term)


class Objective(NamedTuple):
    """The terms of the objective with their weights and scales."""

    code_prior: float  # weight of a code's squared standard deviations, relative to a pixel's squared error
    camera_scale: Float[Tensor, "#views 7"] = torch.tensor([CAMERA_PRIOR_SCALE])
    """scales of :func:`camera_residuals`; infinite where no prior applies, as for a known camera"""
    camera_weight: Float[Tensor, "7"] = torch.tensor(CAMERA_PRIOR_WEIGHT)
    expected_scale: Float[Tensor, "views directions"] | None = None
    """expected log scale of photos for each of :func:`core.classifiers.viewpoint.directions`; None: 0 for all"""
    mask_weight: float = MASK_WEIGHT  # 0 if the network paints the background, which makes all rays opaque
    robust_scale: float = math.inf
    """RMS colour error whose gradient is half as large as in Eq. 5, for content that the model cannot render"""
    occluder_scale: float = math.inf  # the same for errors outside the mask, where an occluder may hide the object
    terms: tuple[Callable[[PixelBatch, "Objective"], Term], ...] = TERMS  # built for some pixels and this objective


class ObjectiveValue(NamedTuple):
    """The objective of hypotheses on some pixels."""

    objective: Float[Tensor, "hypotheses"]  # the sum of the terms
    squared_error: Float[Tensor, "hypotheses"]
    """mean squared error per channel over whole photos, estimated from these pixels"""


def evaluate_objective(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int,
    objective: Objective,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
    origin: Latents | None = None,
) -> ObjectiveValue:
    """Evaluate the objective (Eq. 5 with robust errors, a mask and priors) on some pixels; differentiable.

    Args:
        samples: intervals of each ray.
        cells: cells that each shape may occupy; None: ``model.occupied_cells``.
        origin: see :func:`core.fitting.biases.hypothesis_biases`.
    """
    return objective_value(
        objective, parameters, render_pixels(model, parameters, pixels, samples, cells, origin), pixels
    )


def objective_value(
    objective: Objective, parameters: Parameters, rendered: RenderedPixels, pixels: PixelBatch
) -> ObjectiveValue:
    """Return the objective of hypotheses from their renders of some pixels."""
    terms = [term(pixels, objective) for term in objective.terms]
    value = torch.stack([term_value(term, term.residual(parameters, rendered)) for term in terms]).sum(0)
    return ObjectiveValue(value, image_squared_error(rendered, pixels, objective.occluder_scale).detach())


def render_pixels(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
    origin: Latents | None = None,
) -> RenderedPixels:
    """Render pixels by hypotheses; arguments as in :func:`evaluate_objective`."""
    biases = hypothesis_biases(model, parameters, origin)
    return _render(model, parameters, biases, pixels, samples, None, cells)


def paper_objective(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int,
    code_prior: float,
    jitter: Float[Tensor, "views all_rays"] | None,
) -> ObjectiveValue:
    """Evaluate the original Eq. 5: mean squared colour error and squared norms of the codes; differentiable.

    Args:
        parameters: shape and texture are the codes themselves.
    """
    biases = model.field.biases(parameters.shape, parameters.texture)
    rendered = _render(model, parameters, biases, pixels, samples, jitter)
    error = image_squared_error(rendered, pixels)
    norms = parameters.shape.square().sum(-1) + parameters.texture.square().sum(-1)
    return ObjectiveValue(error + code_prior * norms, error.detach())


def image_squared_error(
    rendered: RenderedPixels, pixels: PixelBatch, occluder_scale: float = math.inf
) -> Float[Tensor, "hypotheses"]:
    """Estimate the mean squared colour error (0..1 per channel) over whole photos from some of their pixels.

    Pixels outside the mask that the object covers are down-weighted as in the objective.

    Args:
        occluder_scale: see :class:`Objective`.
    """
    scale = _scales(pixels, math.inf, occluder_scale)
    visibility = cauchy_slope((rendered.opacity - pixels.target_opacity).square(), scale)
    squared = visibility * (rendered.colour - pixels.colours).square().mean(-1)
    return (squared * pixels.weights).sum((1, 2)) / squared.shape[1]


def camera_residuals(
    parameters: Parameters, expected_scale: Float[Tensor, "views directions"] | None = None
) -> Float[Tensor, "hypotheses views 7"]:
    """Return the residuals of the camera prior, in the order of :data:`CAMERA_PRIOR_SCALE`.

    Elevation below the ground (rad, at most 0), log distance over the model's, log focal length over the given one, and
    the crop transform, its log scale relative to the expected one.
    """
    azimuth, elevation = parameters.angles.unbind(-1)
    scale = parameters.crop_transform[..., 0]
    if expected_scale is not None:  # constant during a step
        scale = scale - (direction_weights(azimuth, elevation) * expected_scale).sum(-1).detach()
    first = elevation.clamp_max(0), parameters.distance, parameters.zoom, scale
    return torch.cat((torch.stack(first, -1), parameters.crop_transform[..., 1:]), -1)


def viewpoint_weights(
    parameters: Parameters, probabilities: Sequence[Float[Tensor, "directions"] | None]
) -> Float[Tensor, "hypotheses"]:
    """Return factors on the losses of hypotheses, at least 1, larger for unlikely viewpoints.

    Args:
        probabilities: of every view, from :func:`core.classifiers.viewpoint.predict_viewpoint`, or None.
    """
    nll = torch.zeros(len(parameters.angles))
    for probability, angles in zip(probabilities, parameters.angles.unbind(1), strict=True):
        if probability is not None:
            nll += viewpoint_nll(probability, *angles.unbind(-1))
    return (_VIEWPOINT_LOSS_WEIGHT * nll).exp()


def _scales(pixels: PixelBatch, on_object: float, outside: float) -> Float[Tensor, "views rays"]:
    """Return a scale for each pixel: ``on_object`` inside the mask, ``outside`` elsewhere."""
    scale = torch.full_like(pixels.target_opacity, on_object)
    return scale.masked_fill(pixels.target_opacity < 0.5, outside)


def _render(
    model: Model,
    parameters: Parameters,
    biases: tuple[Tensor, Tensor],
    pixels: PixelBatch,
    samples: int,
    jitter: Float[Tensor, "views all_rays"] | None,
    cells: Bool[Tensor, "hypotheses x y z"] | None = None,
) -> RenderedPixels:
    rays = hypothesis_rays(model, parameters, pixels, samples, jitter)
    coloured = max(2, samples // 6)
    cells = known_cells(model, cells)

    def render(piece: Piece) -> tuple[Tensor]:
        shape, texture = (bias[piece[0]] for bias in biases)
        piece_cells = cells_of(cells, piece[0])
        with autocast(model.device):
            return (render_top_samples(model, rays[piece], samples, coloured, shape, texture, piece_cells).cpu(),)

    everything = (slice(None),) * 3
    (channels,) = render(everything) if torch.is_grad_enabled() else map_rays(render, rays.near.shape, samples)
    return RenderedPixels(pixels.mean_of_rays(channels))
