"""The network stage of a fit: photos from several sides free the weights of the object's network.

Freedom grows with evidence (:func:`frees_network`). From the object with free biases on, Adam moves weights, biases and
unknown cameras together. Two prices join the loss of the search: the squared distance from the category's weights, and
haze as random cameras see it, because half-transparent matter explains thin parts best while cameras are slightly off.
An update counts only if it lowers the objective, haze included, on pixels that no step sees.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.biases import hypothesis_biases
from core.fitting.hypotheses import (
    HypothesisBatch,
    Parameters,
    clamp_parameters,
    from_vector,
    hypothesis_rays,
    to_vector,
)
from core.fitting.objective import RenderedPixels, objective_value, viewpoint_weights
from core.fitting.observations import Observation, sample_pixels
from core.fitting.problem import SCORING_RAYS, Problem
from core.fitting.schedule import Stage
from core.geometry.rays import Rays, rays_at_pixels
from core.models.field import Field
from core.models.latents import Latents
from core.models.model import Model
from core.models.network import copy_field, weight_offsets, with_network
from core.rendering.importance import render_top_samples
from core.rendering.shape_cells import shape_cells
from core.runtime.pool import pause
from core.runtime.precision import autocast

MIN_PHOTOS = 3
_MIN_ARC = math.radians(90)  # of azimuth: photos of one side do not show the others
_UPDATE = 10  # steps between updates, in which the same network chooses the samples of rays
_RAYS = 512  # of a step, shared by all photos
_HAZE_CAMERAS = 8
_HAZE_RAYS = 16  # of each random camera in a step
_RATE = 5e-4  # of weights, at the first step
_BIAS_RATE = 0.02  # standard deviations
_CAMERA_RATE = 1e-3  # rad; logarithm of lengths; focal lengths
_DECAY = 0.1  # of all rates until the last step
_MASK_WEIGHT = 0.2  # of the squared error of opacity, relative to that of colour; with 0.5, colours are worse
_WEIGHT_PRIOR = 100.0  # of a weight's squared offset, relative to that of a bias in standard deviations
_HAZE_PRICE = 0.02  # of the mean of a(1-a) for opacities a, relative to a pixel's squared error
_BETAS = (0.9, 0.99)  # of Adam: so few steps need a short memory of squares
_HIGHEST = 1.0  # rad of elevation of random cameras
_HELD_OUT = 8  # every eighth pixel is held out


def frees_network(problem: Problem, winner: HypothesisBatch) -> bool:
    """Return True if photos determine a network: three or more, spread over at least 90 degrees of azimuth.

    Photos that are left out do not count. The spread is the shortest arc that holds all cameras' azimuths.
    """
    azimuth = (winner.parameters.angles[0, problem.included, 0] % (2 * math.pi)).sort().values
    if len(azimuth) < MIN_PHOTOS or not problem.components.network:
        return False
    gaps = torch.cat((azimuth, azimuth[:1] + 2 * math.pi)).diff()
    return 2 * math.pi - float(gaps.max()) >= _MIN_ARC


def free_network(
    problem: Problem, origin: Latents, freed: HypothesisBatch, stage: Stage, generator: torch.Generator
) -> Iterator[tuple[Latents, HypothesisBatch]]:
    """Yield the codes with the best network so far, and its biases and cameras, after each update.

    Args:
        origin, freed: codes, and the hypothesis of free biases around them, as :func:`core.fitting.free.free_object`
            yields them.
        stage: of the biases; there are as many updates as it has steps.
    """
    training = _Training(problem, origin, freed, stage, generator)
    best = origin, training.scored()[1]
    for _ in range(stage.steps):
        if training.is_finite:
            training.update()
        if training.is_finite:
            best = min(best, training.scored(), key=lambda candidate: float(candidate[1].loss))
        yield best


class _Training:
    """Adam on the weights of an object's network, on its biases and on unknown cameras."""

    def __init__(
        self, problem: Problem, origin: Latents, start: HypothesisBatch, stage: Stage, generator: torch.Generator
    ) -> None:
        self._problem = problem
        self._origin = origin
        self._start = start
        self._samples = stage.samples
        self._objective = problem.objective(stage.robust_scale)
        self._generator = generator
        # Steps do not see the pixels that scores are of.
        self._observations, held_out = zip(*map(_divided, problem.observations), strict=True)
        self._held_out = sample_pixels(held_out, max(1, SCORING_RAYS // len(held_out)), generator)
        self._haze_rays = _random_rays(problem.model, SCORING_RAYS // (4 * _HAZE_CAMERAS), generator)
        self._field = copy_field(problem.model.field)
        self._rates = torch.cat(
            (
                _CAMERA_RATE * problem.free.flatten(),
                torch.full((start.parameters.shape.shape[1] + start.parameters.texture.shape[1],), _BIAS_RATE),
            )
        )
        self._moved = torch.zeros_like(self._rates, requires_grad=True)  # in units of the rates
        self._leaves = [weight if weight._base is None else weight._base for weight in _weights(self._field)]
        groups = [{"params": self._leaves, "lr": _RATE}, {"params": [self._moved], "lr": 1.0}]
        self._adam = torch.optim.Adam(groups, betas=_BETAS)
        self._schedule = torch.optim.lr_scheduler.ExponentialLR(self._adam, _DECAY ** (1 / (_UPDATE * stage.steps)))

    @property
    def is_finite(self) -> bool:
        """False once the training diverged."""
        return all(bool(leaf.isfinite().all()) for leaf in (*self._leaves, self._moved))

    def update(self) -> None:
        """Take the steps of an update."""
        present = with_network(self._problem.model, self._network())
        with torch.no_grad():
            cells = shape_cells(present, self._biases(self._parameters())[0])
        trained = replace(present, field=self._field)
        for leaf in self._leaves:  # not the layers shared with the category
            leaf.requires_grad_(True)
        for _ in range(_UPDATE):
            loss = self._loss(trained, present, cells)
            self._adam.zero_grad()
            loss.backward()
            if (gradient := self._field.direction_layer.weight.grad) is not None:
                gradient[:, self._field.config.width :] = 0.0  # of directions (Field.texture_weights)
            self._adam.step()
            self._schedule.step()
            pause()

    def scored(self) -> tuple[Latents, HypothesisBatch]:
        """Return the codes with the present network, and the hypothesis with its score as loss."""
        problem = self._problem
        origin = self._network()
        present = with_network(problem.model, origin)
        with torch.no_grad():
            parameters = clamp_parameters(self._parameters(), problem.unknown)
            biases = self._biases(parameters)
            cells = shape_cells(present, biases[0])
            rays = hypothesis_rays(present, parameters, self._held_out, self._samples)
            rendered = RenderedPixels(self._held_out.mean_of_rays(_render(present, rays, self._samples, biases, cells)))
            value = objective_value(self._objective, parameters, rendered, self._held_out)
            haze = _haze(_render(present, self._haze_rays, self._samples, biases, None))
        loss = (value.objective + _HAZE_PRICE * haze) * viewpoint_weights(parameters, problem.viewpoints)
        return origin, replace(self._start, parameters=parameters, loss=loss, squared_error=value.squared_error)

    def _loss(self, trained: Model, present: Model, cells: Bool[Tensor, "1 x y z"] | None) -> Float[Tensor, ""]:
        """Return the loss of a step on random pixels and random cameras."""
        parameters = self._parameters()
        biases = self._biases(parameters)
        pixels = sample_pixels(self._observations, max(1, _RAYS // len(self._observations)), self._generator)
        jitter = torch.rand(pixels.points.shape[:2], generator=self._generator) - 0.5
        rays = hypothesis_rays(present, parameters, pixels, self._samples, jitter)
        rendered = RenderedPixels(pixels.mean_of_rays(_render(trained, rays, self._samples, biases, cells, present)))
        objective = self._objective._replace(mask_weight=_MASK_WEIGHT)
        value = objective_value(objective, parameters, rendered, pixels).objective[0]
        haze_rays = _random_rays(present, _HAZE_RAYS, self._generator)
        haze = _haze(_render(trained, haze_rays, self._samples, biases, cells, present))
        offsets = torch.cat(_weights(self._field)) - torch.cat(_weights(self._problem.model.field))
        prior = _WEIGHT_PRIOR * self._objective.code_prior * offsets.square().sum()
        return value + _HAZE_PRICE * haze + prior.cpu()

    def _parameters(self) -> Parameters:
        start = self._start.parameters
        return from_vector(to_vector(start) + self._rates * self._moved, start)

    def _biases(self, parameters: Parameters) -> tuple[Tensor, Tensor]:
        return hypothesis_biases(self._problem.model, parameters, self._origin)

    def _network(self) -> Latents:
        """Return the codes with the present network."""
        model = self._problem.model
        shape, texture = (
            torch.cat((torch.zeros_like(std).half(), offsets)).cpu()
            for std, offsets in zip(model.bias_std, weight_offsets(self._field, model.field), strict=True)
        )
        return replace(self._origin, shape_offsets=shape, texture_offsets=texture)


def _weights(field: Field) -> tuple[Float[Tensor, "_ width"], ...]:
    return *field.shape_weights, *field.texture_weights


def _divided(observation: Observation) -> tuple[Observation, Observation]:
    """Divide a photo's pixels into those to train on and held-out ones."""
    training = []
    held_out = []
    for stratum in observation.strata:
        mask = torch.arange(len(stratum)) % _HELD_OUT == 0
        training.append(stratum[~mask] if len(stratum) > 1 else stratum)
        held_out.append(stratum[mask])
    return replace(observation, strata=tuple(training)), replace(observation, strata=tuple(held_out))


def _random_rays(model: Model, count: int, generator: torch.Generator) -> Rays:
    """Return rays of random cameras around the object, of (1, cameras, rays)."""
    bundles = []
    for azimuth, height in torch.rand(_HAZE_CAMERAS, 2, generator=generator).tolist():
        camera = model.camera(2 * math.pi * azimuth, _HIGHEST * height)
        pixels = model.image_size * torch.rand(count, 2, generator=generator)
        bundles.append(rays_at_pixels(pixels.to(model.device), camera, model.extent_tensor))
    names = "origins", "directions", "near", "far"
    return Rays(*(torch.stack([getattr(rays, name) for rays in bundles])[None] for name in names))


def _haze(channels: Float[Tensor, "1 views rays 4"]) -> Float[Tensor, ""]:
    opacity = channels[..., 3]
    return (opacity * (1 - opacity)).mean()


def _render(
    model: Model,
    rays: Rays,
    samples: int,
    biases: tuple[Tensor, Tensor],
    cells: Bool[Tensor, "1 x y z"] | None,
    present: Model | None = None,
) -> Float[Tensor, "1 views rays 4"]:
    """Render rays, and return them on the processor.

    Gradients go through the weights if a present network chooses the samples.
    """
    with autocast(model.device):
        return render_top_samples(model, rays, samples, max(2, samples // 6), *biases, cells, present).cpu()
