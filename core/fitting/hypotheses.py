"""Hypotheses about photos: a camera for each and one pair of codes, many hypotheses in one batch."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.fitting.observations import PixelBatch
from core.geometry.camera import Camera, camera_rotation
from core.geometry.rays import Rays, cast_rays
from core.models.codes import Codes
from core.models.model import Instance, Model

CAMERA_PARAMETERS = 8  # of one view: azimuth, elevation, log distance, log focal length; log scale, roll, shift x and y
_BASIN = math.radians(20)  # cameras closer than this mostly converge to the same one
MIN_ZOOM = -1.4  # log of the shortest focal length over the model's: of 13 mm, if the object fills the photo
MAX_ZOOM = 1.5  # log of the longest focal length over the given one: with a longer one, perspective is invisible
_MAX_ELEVATION = math.radians(89.9)


class DivergedError(ValueError):
    """Raised if no hypothesis has a finite loss."""

    def __init__(self) -> None:
        super().__init__("the fit diverged from every start")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation of the photos, from which a fit can resume."""

    origin: int  # number of the initial hypothesis it comes from
    loss: float
    cameras: tuple[Camera, ...]  # one per photo, at the photo's size
    instance: Instance
    crop_transform: Float[Tensor, "views 4"]  # see Parameters; its scale is included in the cameras' focal lengths

    def without(self, views: Collection[int]) -> "Hypothesis":
        """Return the hypothesis about the other photos."""
        remaining = [view for view in range(len(self.cameras)) if view not in views]
        cameras = tuple(self.cameras[view] for view in remaining)
        return replace(self, cameras=cameras, crop_transform=self.crop_transform[remaining])


class Parameters(NamedTuple):
    """The searched parameters.

    Azimuth and elevation are searched directly: for an upright camera aimed at the origin the metric of (azimuth,
    elevation) is constant, also at the pole, where azimuth is roll.
    """

    angles: Float[Tensor, "hypotheses views 2"]  # azimuth, elevation; rad
    distance: Float[Tensor, "hypotheses views"]
    """log of the distance over the model's; the camera's distance is the model's times exp(distance + zoom)"""
    zoom: Float[Tensor, "hypotheses views"]
    """Log of the focal length over the given one. The camera moves away in proportion, so that the object keeps its
    size and only the perspective changes."""
    crop_transform: Float[Tensor, "hypotheses views 4"]
    """Map from the camera's image to the photo: log scale (a crop zooms without moving the camera), roll (rad,
    clockwise), and position of the optical axis (x right, y down, in given focal lengths)."""
    shape: Float[Tensor, "hypotheses shape_rank"]
    """standard deviations along the principal directions; in the paper's recipe the code itself"""
    texture: Float[Tensor, "hypotheses texture_rank"]


@dataclass(frozen=True, eq=False)
class HypothesisBatch:
    """Hypotheses during optimisation."""

    parameters: Parameters
    loss: Float[Tensor, "hypotheses"]
    """for ranking: running mean of the objective, weighted by the viewpoint classifier; infinite if diverged"""
    squared_error: Float[Tensor, "hypotheses"]  # see ObjectiveValue
    origin: Int[Tensor, "hypotheses"]  # number of the initial hypothesis that each comes from

    @classmethod
    def of(cls, parameters: Parameters) -> "HypothesisBatch":
        """Build a batch of initial hypotheses, numbered in order."""
        zeros = torch.zeros(len(parameters.angles))
        return cls(parameters, zeros, zeros, torch.arange(len(zeros)))

    def __len__(self) -> int:
        return len(self.loss)

    def __getitem__(self, index: Int[Tensor, "selected"]) -> "HypothesisBatch":
        """Return the batch of some hypotheses, in the order of ``index``."""
        parameters = Parameters(*(values[index] for values in self.parameters))
        return HypothesisBatch(parameters, self.loss[index], self.squared_error[index], self.origin[index])

    @property
    def leader(self) -> int:
        """Index of the hypothesis of least loss. Raises :class:`DivergedError` if all have diverged."""
        best = int(self.loss.argmin())
        if not math.isfinite(float(self.loss[best])):
            raise DivergedError
        return best

    @property
    def best(self) -> "HypothesisBatch":
        """The leader, as a batch of one."""
        return self[torch.tensor([self.leader])]


def concatenate(*batches: HypothesisBatch) -> HypothesisBatch:
    """Concatenate batches of the same photos and code sizes."""
    names = ("loss", "squared_error", "origin")
    parameters = Parameters(*map(torch.cat, zip(*(batch.parameters for batch in batches), strict=True)))
    return HypothesisBatch(parameters, *(torch.cat([getattr(batch, name) for batch in batches]) for name in names))


def mean_parameters(batches: Sequence[HypothesisBatch]) -> HypothesisBatch:
    """Average the parameters of batches of equal size; loss, error and origin are those of the last batch."""
    stacks = map(torch.stack, zip(*(batch.parameters for batch in batches), strict=True))
    return replace(batches[-1], parameters=Parameters(*(stack.mean(0) for stack in stacks)))


def to_vector(parameters: Parameters) -> Float[Tensor, "hypotheses parameters"]:
    """Flatten the parameters, detached: cameras view by view, then shape and texture."""
    angles, distance, zoom, crop_transform, shape, texture = parameters
    cameras = torch.cat((angles, distance[..., None], zoom[..., None], crop_transform), -1)
    return torch.cat((cameras.flatten(1), shape, texture), 1).detach()


def from_vector(vector: Float[Tensor, "any parameters"], sizes: Parameters) -> Parameters:
    """Invert :func:`to_vector` for parameters of the same sizes as ``sizes``."""
    views = sizes.distance.shape[1]
    cameras, *codes = vector.split((views * CAMERA_PARAMETERS, sizes.shape.shape[1], sizes.texture.shape[1]), 1)
    angles, distance, zoom, crop_transform = cameras.unflatten(1, (views, -1)).split((2, 1, 1, 4), -1)
    return Parameters(angles, distance[..., 0], zoom[..., 0], crop_transform, *codes)


def one_view(parameters: Parameters, view: int) -> Parameters:
    """Return the parameters of a single view."""
    return parameters._replace(
        angles=parameters.angles[:, [view]],
        distance=parameters.distance[:, [view]],
        zoom=parameters.zoom[:, [view]],
        crop_transform=parameters.crop_transform[:, [view]],
    )


# Cameras and rays


def hypothesis_rays(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int = 1,
    jitter: Float[Tensor, "views all_rays"] | None = None,
) -> Rays:
    """Cast the rays of some pixels, (hypotheses, views, all rays), on the model's device.

    Rays are clipped to the box or, if the network paints the background, to depths within 0.5 of the origin's.

    Args:
        samples: intervals of each ray, the unit of ``jitter``.
        jitter: shift of each ray's samples, in [-0.5, 0.5].
    """
    device = model.device
    distance = (model.distance * (parameters.distance + parameters.zoom).exp()).to(device)[..., None]
    points = image_points(parameters, pixels.points).to(device)
    angles = parameters.angles.to(device)[..., None, :]
    rays = cast_rays(points, angles[..., 0], angles[..., 1], distance, 1.0, (0, 0), model.extent_tensor)
    if model.white_from_network:
        near = (rays.origins.detach().norm(dim=-1) - 0.5).expand_as(rays.near)
        rays = replace(rays, near=near, far=near + 1.0)
    if jitter is not None:
        shift = jitter.to(device) * (rays.far - rays.near) / samples
        rays = replace(rays, near=rays.near + shift, far=rays.far + shift)
    return rays


def image_points(
    parameters: Parameters, pixels: Float[Tensor, "views rays 2"]
) -> Float[Tensor, "hypotheses views rays 2"]:
    """Map pixels to upright images aimed at the object; both in focal lengths from the middle, x right, y down."""
    scale, roll, shift = parameters.crop_transform[..., None, :].split((1, 1, 2), -1)
    x, y = (pixels - shift).unbind(-1)
    cos = roll[..., 0].cos()
    sin = roll[..., 0].sin()
    upright = torch.stack((cos * x + sin * y, cos * y - sin * x), -1)
    return upright / (scale + parameters.zoom[..., None, None]).exp()


def known_cells(
    model: Model, cells: Bool[Tensor, "hypotheses x y z"] | None
) -> Bool[Tensor, "hypotheses_or_one x y z"] | None:
    """Return the hypotheses' cells or, if unknown, the cells of all objects; on the model's device."""
    if cells is None and model.occupied_cells is not None:
        return model.occupied_cells[None].to(model.device)
    return cells


def clamp_parameters(parameters: Parameters, views: Bool[Tensor, "views"]) -> Parameters:
    """Clamp the camera parameters of the marked views, except azimuths, to the searched range."""
    azimuth, elevation = parameters.angles.unbind(-1)
    elevation = elevation.clamp(-_MAX_ELEVATION, _MAX_ELEVATION).where(views, elevation)
    return parameters._replace(
        angles=torch.stack((azimuth, elevation), -1),
        distance=parameters.distance.clamp(-1.0, 1.5).where(views, parameters.distance),
        zoom=parameters.zoom.clamp(MIN_ZOOM, MAX_ZOOM).where(views, parameters.zoom),
        crop_transform=parameters.crop_transform.clamp(-1.0, 1.0).where(views[:, None], parameters.crop_transform),
    )


def to_cameras(model: Model, parameters: Parameters, index: int, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """Return the cameras of one hypothesis.

    Args:
        cameras: one per view, with the photo's size and the given focal length.
    """
    fitted = []
    for view, camera in enumerate(cameras):
        azimuth, elevation = (float(angle) for angle in parameters.angles[index, view])
        azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
        zoom = float(parameters.zoom[index, view])
        distance = model.distance * math.exp(float(parameters.distance[index, view]) + zoom)
        focal = camera.focal * math.exp(zoom + float(parameters.crop_transform[index, view, 0]))
        fitted.append(replace(camera, azimuth=azimuth, elevation=elevation, distance=distance, focal=focal))
    return tuple(fitted)


def to_hypotheses(
    model: Model, batch: HypothesisBatch, cameras: Sequence[Camera], codes: Sequence[Codes]
) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a batch by loss, without diverged ones.

    Args:
        model: the one to show them with.
        cameras: see :func:`to_cameras`.
        codes: of all hypotheses (:func:`core.fitting.biases.hypothesis_codes`).
    """
    losses = batch.loss.tolist()
    return tuple(
        Hypothesis(
            int(batch.origin[index]),
            losses[index],
            to_cameras(model, batch.parameters, index, cameras),
            Instance(model, codes[index]),
            batch.parameters.crop_transform[index],
        )
        for index in batch.loss.argsort(stable=True).tolist()
        if math.isfinite(losses[index])
    )


# Basins: cameras from which fits mostly converge to the same one


def turn_azimuth(batch: HypothesisBatch, turn: float, views: Bool[Tensor, "views"]) -> HypothesisBatch:
    """Return the hypotheses with the cameras of the marked views turned about the vertical, rad."""
    angles = batch.parameters.angles.clone()
    angles[:, views, 0] += turn
    return replace(batch, parameters=batch.parameters._replace(angles=angles))


def by_loss(batch: HypothesisBatch) -> Int[Tensor, "selected"]:
    """Return the indices of finite hypotheses by loss. Raises :class:`DivergedError` if there are none."""
    order = batch.loss.argsort(stable=True)
    order = order[batch.loss[order].isfinite()]
    if not len(order):
        raise DivergedError
    return order


def other_basins(batch: HypothesisBatch, winner: HypothesisBatch, views: Bool[Tensor, "views"]) -> HypothesisBatch:
    """Return the best hypothesis of each basin but the winner's, by loss; diverged ones are left out.

    Args:
        winner: a single hypothesis.
        views: their cameras define a basin.
    """
    near = _same_basin(batch, batch, views)
    free = batch.loss.isfinite() & ~_same_basin(winner, batch, views)[0]
    selected = list[int]()
    for index in batch.loss.argsort(stable=True).tolist():
        if free[index]:
            selected.append(index)
            free &= ~near[index]
    return batch[torch.tensor(selected, dtype=torch.long)]


def _same_basin(
    first: HypothesisBatch, second: HypothesisBatch, views: Bool[Tensor, "views"]
) -> Bool[Tensor, "firsts seconds"]:
    """Mark pairs of hypotheses that share a basin in all these views."""
    rotations = [camera_rotation(*batch.parameters.angles[:, views].unbind(-1)) for batch in (first, second)]
    cosines = (torch.einsum("avij,bvij->abv", *rotations) - 1) / 2
    return (cosines > math.cos(_BASIN)).all(-1)
