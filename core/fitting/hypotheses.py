"""Hypotheses about what photos show: a camera for each and one pair of codes, many hypotheses in one batch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.fitting.observations import PixelBatch
from core.geometry.camera import Camera, camera_rotation
from core.geometry.rays import Rays, cast_rays
from core.models.codes import Codes, CodeSpace
from core.models.model import Model
from core.rendering.shape_cells import shape_cells

CAMERA_PARAMETERS = 8
"""of one view: azimuth, elevation, logarithms of distance and focal length; logarithm of scale, roll, shift x and y"""
_BASIN = math.radians(25)  # Cameras that differ by less mostly converge to the same one.
_SIMILAR_FOCAL = 0.2  # So do those with focal lengths whose logarithms differ by less.
_OPPOSITE_COSINE = -0.6  # of the difference between two azimuths, where the cameras look from opposite sides
MAX_ZOOM = 1.5
"""logarithm of the longest focal length over the given one: beyond, there is no perspective left to be seen"""
_MAX_ELEVATION = math.radians(89.9)


class DivergedError(ValueError):
    """No hypothesis is finite any more."""

    def __init__(self) -> None:
        super().__init__("the fit diverged from every start")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation of the photos. A fit can resume from it."""

    origin: int  # the number of the initial hypothesis that it comes from
    loss: float
    cameras: tuple[Camera, ...]  # one per photo, at the photo's size
    codes: Codes
    crop_transform: Float[Tensor, "views 4"]  # as in Parameters; its scale is a part of the cameras' focal lengths


class Parameters(NamedTuple):
    """All that is searched for.

    Azimuth and elevation are searched directly: for an upright camera aimed at the origin the metric of (azimuth,
    elevation) is constant, also at the pole, where azimuth is roll.
    """

    angles: Float[Tensor, "hypotheses views 2"]  # azimuth, elevation; rad
    distance: Float[Tensor, "hypotheses views"]
    """logarithm of the distance over the model's, as far as the focal length does not make up for it"""
    zoom: Float[Tensor, "hypotheses views"]
    """logarithm of the focal length over the given one. The camera is as much further away, so that the object keeps
    its size and only the perspective changes."""
    crop_transform: Float[Tensor, "hypotheses views 4"]
    """How a photo shows what its camera sees: the logarithm of its scale (a crop is a zoom, from where the camera is),
    its roll (rad, clockwise), and where the optical axis is, x right and y down, in focal lengths as given."""
    shape: Float[Tensor, "hypotheses shape_rank"]
    """standard deviations along the principal directions; in the paper's recipe the code itself"""
    texture: Float[Tensor, "hypotheses texture_rank"]


@dataclass(frozen=True, eq=False)
class HypothesisBatch:
    """Hypotheses while they are optimised."""

    parameters: Parameters
    loss: Float[Tensor, "hypotheses"]
    """what they are ranked by: a running mean of the objective, weighed with the viewpoint classifier; infinite where a
    hypothesis diverged"""
    squared_error: Float[Tensor, "hypotheses"]  # as in ObjectiveValue
    origin: Int[Tensor, "hypotheses"]

    @classmethod
    def of(cls, parameters: Parameters) -> "HypothesisBatch":
        """Initial hypotheses, numbered in their order."""
        zeros = torch.zeros(len(parameters.angles))
        return cls(parameters, zeros, zeros, torch.arange(len(zeros)))

    def __len__(self) -> int:
        return len(self.loss)

    def __getitem__(self, index: Int[Tensor, "some"]) -> "HypothesisBatch":
        parameters = Parameters(*(part[index] for part in self.parameters))
        return HypothesisBatch(parameters, self.loss[index], self.squared_error[index], self.origin[index])

    @property
    def leader(self) -> int:
        """The index of the least loss. Raises :class:`DivergedError` where all have diverged."""
        best = int(self.loss.argmin())
        if not math.isfinite(float(self.loss[best])):
            raise DivergedError
        return best

    @property
    def best(self) -> "HypothesisBatch":
        """The leader alone."""
        return self[torch.tensor([self.leader])]


def concatenate(*batches: HypothesisBatch) -> HypothesisBatch:
    """All hypotheses of some batches."""
    names = ("loss", "squared_error", "origin")
    parameters = Parameters(*map(torch.cat, zip(*(batch.parameters for batch in batches), strict=True)))
    return HypothesisBatch(parameters, *(torch.cat([getattr(batch, name) for batch in batches]) for name in names))


def mean_parameters(batches: Sequence[HypothesisBatch]) -> HypothesisBatch:
    """The last batch, at the mean of the parameters of them all."""
    parameters = (torch.stack(parts).mean(0) for parts in zip(*(batch.parameters for batch in batches), strict=True))
    return replace(batches[-1], parameters=Parameters(*parameters))


def to_vector(parameters: Parameters) -> Float[Tensor, "hypotheses parameters"]:
    """The parameters in a row: of the cameras, view by view, then of shape and texture."""
    angles, distance, zoom, crop_transform, shape, texture = parameters
    cameras = torch.cat((angles, distance[..., None], zoom[..., None], crop_transform), -1)
    return torch.cat((cameras.flatten(1), shape, texture), 1).detach()


def from_vector(vector: Float[Tensor, "any parameters"], sizes: Parameters) -> Parameters:
    """The inverse of :func:`to_vector`, for parameters with as many views and directions as ``sizes``."""
    views, shape = sizes.distance.shape[1], sizes.shape.shape[1]
    cameras, *codes = vector.split((views * CAMERA_PARAMETERS, shape, sizes.texture.shape[1]), 1)
    angles, distance, zoom, crop_transform = cameras.unflatten(1, (views, -1)).split((2, 1, 1, 4), -1)
    return Parameters(angles, distance[..., 0], zoom[..., 0], crop_transform, *codes)


# Cameras and rays


def hypothesis_rays(
    model: Model,
    parameters: Parameters,
    pixels: PixelBatch,
    samples: int = 1,
    jitter: Float[Tensor, "views all_rays"] | None = None,
) -> Rays:
    """The rays of some pixels, (hypotheses, views, all rays), on the model's device.

    They are clipped to the box; where the network itself paints the background, to the depths it was trained on.

    Args:
        jitter: (views, all rays) in [-0.5, 0.5], by how many intervals the samples of a ray are moved along it.
    """
    device = model.device
    distance = (model.distance * (parameters.distance + parameters.zoom).exp()).to(device)[..., None]
    points = image_points(parameters, pixels.points).to(device)
    angles = parameters.angles.to(device)[..., None, :]
    rays = cast_rays(points, angles[..., 0], angles[..., 1], distance, 1.0, (0, 0), model.extent_tensor)
    near, far = rays.near, rays.far
    if model.white_from_network:
        near = (rays.origins.detach().norm(dim=-1) - 0.5).expand_as(near)
        far = near + 1.0
    if jitter is not None:
        move = jitter.to(near.device) * (far - near) / samples
        near, far = near + move, far + move
    return replace(rays, near=near, far=far)


def image_points(
    parameters: Parameters, pixels: Float[Tensor, "views rays 2"]
) -> Float[Tensor, "hypotheses views rays 2"]:
    """Where pixels are in the images of upright cameras that look at the object; x right and y down from the middle, in
    focal lengths.
    """
    scale, roll, shift = parameters.crop_transform[..., None, :].split((1, 1, 2), -1)
    x, y = (pixels - shift).unbind(-1)
    cos, sin = roll[..., 0].cos(), roll[..., 0].sin()
    upright = torch.stack((cos * x + sin * y, cos * y - sin * x), -1)
    return upright / (scale + parameters.zoom[..., None, None]).exp()


def hypothesis_cells(model: Model, parameters: Parameters) -> Bool[Tensor, "hypotheses x y z"] | None:
    """The cells of the box that each hypothesis' shape may occupy, as :func:`core.rendering.shape_cells.shape_cells`
    finds them.
    """
    return shape_cells(model, model.field.shape_bias(model.codes.shape_space.code(parameters.shape)))


def known_cells(
    model: Model, cells: Bool[Tensor, "hypotheses x y z"] | None
) -> Bool[Tensor, "hypotheses_or_one x y z"] | None:
    """The cells of hypotheses, where those are not known the cells of all objects; on the model's device."""
    if cells is None and model.occupied_cells is not None:
        return model.occupied_cells[None].to(model.device)
    return cells


def clamp_parameters(parameters: Parameters, views: Bool[Tensor, "views"]) -> Parameters:
    """With elevations, distances and focal lengths of these views within the range that is searched."""
    azimuth, elevation = parameters.angles.unbind(-1)
    elevation = elevation.clamp(-_MAX_ELEVATION, _MAX_ELEVATION).where(views, elevation)
    return parameters._replace(
        angles=torch.stack((azimuth, elevation), -1),
        distance=parameters.distance.clamp(-1.0, 1.5).where(views, parameters.distance),
        zoom=parameters.zoom.clamp(-0.5, MAX_ZOOM).where(views, parameters.zoom),
        crop_transform=parameters.crop_transform.clamp(-1.0, 1.0).where(views[:, None], parameters.crop_transform),
    )


def to_cameras(model: Model, parameters: Parameters, index: int, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """The cameras of one hypothesis.

    Args:
        cameras: one per view, with its size and focal length.
    """
    found = []
    for view, camera in enumerate(cameras):
        azimuth, elevation = (float(angle) for angle in parameters.angles[index, view])
        log_distance, zoom = float(parameters.distance[index, view]), float(parameters.zoom[index, view])
        scale = float(parameters.crop_transform[index, view, 0])
        distance, focal = model.distance * math.exp(log_distance + zoom), camera.focal * math.exp(zoom + scale)
        azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
        found.append(replace(camera, azimuth=azimuth, elevation=elevation, distance=distance, focal=focal))
    return tuple(found)


def to_hypotheses(
    model: Model, batch: HypothesisBatch, cameras: Sequence[Camera], spaces: tuple[CodeSpace, CodeSpace]
) -> tuple[Hypothesis, ...]:
    """The hypotheses of a batch, the least loss first, without those that have diverged.

    Args:
        cameras: as for :func:`to_cameras`.
        spaces: of shape and texture.
    """
    parameters, losses = batch.parameters, batch.loss.tolist()
    shapes, textures = spaces[0].code(parameters.shape), spaces[1].code(parameters.texture)
    return tuple(
        Hypothesis(
            int(batch.origin[index]),
            losses[index],
            to_cameras(model, parameters, index, cameras),
            Codes(shapes[index], textures[index], model=model.fingerprint),
            parameters.crop_transform[index],
        )
        for index in batch.loss.argsort(stable=True).tolist()
        if math.isfinite(losses[index])
    )


# Basins: cameras from which a fit mostly ends at the same place


def opposite_views(batch: HypothesisBatch, index: int, views: Bool[Tensor, "views"]) -> Bool[Tensor, "hypotheses"]:
    """Which hypotheses see a view from roughly the opposite side (azimuth + 180 degrees) of where this one does."""
    turn = batch.parameters.angles[:, views, 0] - batch.parameters.angles[index, views, 0]
    return (turn.cos() < _OPPOSITE_COSINE).any(-1)


def flip_azimuth(one: HypothesisBatch, views: Bool[Tensor, "views"]) -> HypothesisBatch:
    """The same hypotheses from the opposite side in these views: the front/back ambiguity."""
    angles = one.parameters.angles.clone()
    angles[:, views, 0] += math.pi
    return replace(one, parameters=one.parameters._replace(angles=angles))


def by_loss(batch: HypothesisBatch) -> Int[Tensor, "some"]:
    """The hypotheses that have not diverged, the least loss first. Raises :class:`DivergedError` where all have."""
    order = batch.loss.argsort(stable=True)
    order = order[batch.loss[order].isfinite()]
    if not len(order):
        raise DivergedError
    return order


def suppress_neighbours(batch: HypothesisBatch, views: Bool[Tensor, "views"]) -> Int[Tensor, "some"]:
    """As :func:`by_loss`, but all that are near a better one come last (non-maximum suppression).

    Near are those of one basin in all these views, and of similar focal lengths.
    """
    zooms = batch.parameters.zoom[:, views]
    near = _same_basin(batch, batch, views) & ((zooms[:, None] - zooms).abs() < _SIMILAR_FOCAL).all(-1)
    best, suppressed = list[int](), list[int]()
    for index in by_loss(batch).tolist():
        (suppressed if best and bool(near[index, best].any()) else best).append(index)
    return torch.tensor(best + suppressed)


def best_other_basin(best: HypothesisBatch, among: HypothesisBatch, views: Bool[Tensor, "views"]) -> HypothesisBatch:
    """The best of ``among`` in another basin than the single ``best``; if there is none, its opposite view, of infinite
    loss as nothing is known of it.
    """
    others = ~_same_basin(best, among, views)[0] & among.loss.isfinite()
    if not bool(others.any()):
        unknown = flip_azimuth(best, views)
        return replace(unknown, loss=torch.full_like(unknown.loss, math.inf))
    return among[among.loss.where(others, torch.tensor(math.inf)).argmin()[None]]


def _same_basin(
    first: HypothesisBatch, second: HypothesisBatch, views: Bool[Tensor, "views"]
) -> Bool[Tensor, "firsts seconds"]:
    """Which hypotheses are in one basin in all these views."""
    one, other = (camera_rotation(*batch.parameters.angles[:, views].unbind(-1)) for batch in (first, second))
    cosines = (torch.einsum("avij,bvij->abv", one, other) - 1) / 2
    return (cosines > math.cos(_BASIN)).all(-1)
