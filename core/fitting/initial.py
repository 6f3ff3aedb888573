"""Initial hypotheses: cameras of the view bank with shapes of its prototypes, or the state of an earlier fit.

Codes have local minima, so shapes compete like cameras do. Every camera of the view bank comes with the prototype whose
render from there is most similar to the photo. Known cameras come with several prototypes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from core.fitting.hypotheses import (
    MAX_ZOOM,
    Hypothesis,
    HypothesisBatch,
    Parameters,
    by_loss,
    clamp_parameters,
    to_cameras,
)
from core.fitting.problem import Problem
from core.fitting.schedule import LOCAL_OFFSETS
from core.geometry.camera import Camera
from core.models.codes import CodeSpace
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.ranking import CandidateCameras, ObjectMask, rank_cameras, shape_similarity

_SHAPE_BLEND = 0.6  # weight of a prototype's shape in an initial shape; the rest is the mean shape
_MIN_DIFFERENCE = 1e-3  # standard deviations from the mean shape below which a prototype is the mean object
_INITIAL_ZOOMS = (0.0, -0.3, 0.3)
"""Initial log focal lengths relative to the model's, if focal lengths are searched: one for each pair of successive
candidates, usually opposite cameras. All are needed, since a code that converged with one focal length keeps it."""
_SIZE_TOLERANCE = 0.25  # log apparent size by which objects vary around their prototype at the same distance


def initial_hypotheses(problem: Problem, count: int, generator: torch.Generator) -> HypothesisBatch:
    """Return at most ``count`` hypotheses at the best matching cameras of the view bank.

    Each has the mean texture and a shape between the mean and the prototypes that match the photos from there. Known
    cameras stay; if all are known, the hypotheses differ in shape only.
    """
    model = problem.model
    space = model.codes.shape_space
    candidates = {
        view: _candidates(problem, view, count, generator) for view in problem.unknown.nonzero()[:, 0].tolist()
    }
    count = min([count, *(len(ranked.azimuth) for ranked in candidates.values())])
    shape = torch.zeros(count, len(space.std))
    if not candidates:
        shape = nearest_shapes(problem, problem.cameras, count)
        count = len(shape)
    batch = HypothesisBatch.of(_at_cameras(model, problem.cameras, shape))
    parameters = batch.parameters
    if problem.settings.estimate_focal:
        zooms = torch.tensor(_INITIAL_ZOOMS).repeat_interleave(2).repeat(count)[:count]
        parameters.zoom[:, problem.unknown] = zooms[:, None]
    for view, ranked in candidates.items():
        _place(problem, view, parameters, ranked)
        if problem.bank and problem.components.prototype_shapes:
            prototypes = space.coordinates(problem.bank.shapes(model.codes))[ranked.prototype[:count]]
            parameters.shape.add_(_SHAPE_BLEND * prototypes / len(candidates))
    return batch


def _place(problem: Problem, view: int, parameters: Parameters, ranked: CandidateCameras) -> None:
    """Put the camera of one view of each hypothesis at a candidate, in place."""
    count = len(parameters.angles)
    photo = problem.photos[view]
    parameters.angles[:, view] = torch.stack((ranked.azimuth, ranked.elevation), -1)[:count]
    log_distance = (ranked.distance[:count] / problem.model.distance).log()
    if not photo.scaled:
        # Objects differ in size too: the distance explains only what exceeds the tolerance.
        log_distance = log_distance - log_distance.clamp(-_SIZE_TOLERANCE, _SIZE_TOLERANCE)
    if photo.cropped:
        parameters.crop_transform[:, view, 2:] = ranked.shift[:count]
    if photo.focal is not None:
        parameters.zoom[:, view] = min(math.log(photo.focal / problem.cameras[view].focal), MAX_ZOOM)
    if photo.cropped and photo.focal is None:
        parameters.crop_transform[:, view, 0] = -log_distance
    else:
        parameters.distance[:, view] = log_distance


def random_angles(count: int, generator: torch.Generator) -> Float[Tensor, "count 2"]:
    """Return azimuths and elevations (rad) uniform on the upper half of the sphere."""
    turn, height = torch.rand(count, 2, generator=generator).unbind(-1)
    return torch.stack((2 * math.pi * turn, height.asin()), -1)


def _candidates(problem: Problem, view: int, count: int, generator: torch.Generator) -> CandidateCameras:
    if problem.bank is None:
        azimuth, elevation = random_angles(count, generator).unbind(-1)
        distance = torch.full((count,), problem.model.distance)
        prototype = torch.zeros(count, dtype=torch.long)
        return CandidateCameras(azimuth, elevation, distance, torch.zeros(count, 2), prototype)
    photo = problem.photos[view]
    image = ObjectMask(photo.mask, problem.cameras[view].focal, photo.unseen)
    return rank_cameras(problem.bank, image, count, problem.viewpoints[view], photo.cropped)


def _at_cameras(model: Model, cameras: Sequence[Camera], shape: Float[Tensor, "count rank"]) -> Parameters:
    """Return parameters of shapes, each with the mean texture and the same cameras."""
    count = len(shape)
    angles = torch.tensor([(camera.azimuth, camera.elevation) for camera in cameras]).repeat(count, 1, 1)
    distance = torch.tensor([math.log(camera.distance / model.distance) for camera in cameras]).repeat(count, 1)
    texture = torch.zeros(count, len(model.codes.texture_space.std))
    return Parameters(angles, distance, torch.zeros_like(distance), torch.zeros(count, len(cameras), 4), shape, texture)


def nearest_shapes(problem: Problem, cameras: Sequence[Camera], count: int) -> Float[Tensor, "count rank"]:
    """Return the mean shape, then shapes towards the prototypes that match the photos best from these cameras.

    Fewer than ``count`` if the view bank has too few prototypes. Without bank, or without the component
    ``prototype_shapes``, the mean shape ``count`` times.
    """
    space = problem.model.codes.shape_space
    mean = torch.zeros(1, len(space.std))
    if count == 1:
        return mean
    bank = problem.bank
    if bank is None or not problem.components.prototype_shapes:
        return mean.expand(count, -1)
    if bank.is_empty:  # With a known camera even an untrained model can be fitted.
        return mean
    shapes = space.coordinates(bank.shapes(problem.model.codes))
    similarity = torch.zeros(len(shapes))
    for photo, camera in zip(problem.photos, cameras, strict=True):
        image = ObjectMask(photo.mask, camera.focal, photo.unseen)
        similarity += shape_similarity(bank, image, camera.azimuth, camera.elevation)
    distinct = (shapes.abs().amax(1) > _MIN_DIFFERENCE).nonzero()[:, 0]
    best = distinct[similarity[distinct].argsort(descending=True)[: count - 1]]
    return torch.cat((mean, _SHAPE_BLEND * shapes[best]))


def local_hypotheses(problem: Problem, batch: HypothesisBatch, count: int) -> HypothesisBatch:
    """Return at most ``count`` hypotheses at and around the best cameras (:data:`core.fitting.schedule.LOCAL_OFFSETS`).

    Codes are fresh: the mean texture, and :func:`nearest_shapes`. Without the component ``fresh_codes``, returns the
    batch itself.
    """
    if not problem.components.fresh_codes:
        return batch
    starts = []
    for index, offsets in zip(by_loss(batch).tolist(), LOCAL_OFFSETS, strict=False):
        cameras = to_cameras(problem.model, batch.parameters, index, problem.cameras)
        nearest = nearest_shapes(problem, cameras, max(nearest_count for *_, nearest_count in offsets))
        starts += [
            (rank, index, move, shape)
            for *move, nearest_count in offsets
            for rank, shape in enumerate(nearest[:nearest_count])
        ]
    starts.sort(key=lambda start: start[0])  # if there are too many, every camera keeps its best matching shapes
    _, indices, moves, shapes = zip(*starts[:count], strict=True)
    copies = batch[torch.tensor(indices)]
    angles = copies.parameters.angles + torch.tensor(moves).deg2rad()[:, None] * problem.unknown[:, None]
    texture = torch.zeros_like(copies.parameters.texture)
    parameters = copies.parameters._replace(angles=angles, shape=torch.stack(shapes), texture=texture)
    return replace(copies, parameters=clamp_parameters(parameters, problem.unknown))


def resume_from(
    model: Model,
    photos: Sequence[Photo],
    cameras: Sequence[Camera],
    hypothesis: Hypothesis,
    spaces: tuple[CodeSpace, CodeSpace],
) -> HypothesisBatch:
    """Return a single hypothesis in the state of an earlier fit, with the photos' own cameras where these are known.

    Args:
        cameras: see :func:`core.fitting.hypotheses.to_cameras`.
        hypothesis: result of the earlier fit.
        spaces: code spaces of shape and texture in which the fit searches.
    """
    starts = [photo.camera or camera for photo, camera in zip(photos, hypothesis.cameras, strict=True)]
    angles = torch.tensor([[(start.azimuth, start.elevation) for start in starts]])
    pairs = zip(starts, cameras, strict=True)
    zoom = torch.tensor([[math.log(start.focal / camera.focal) for start, camera in pairs]])
    zoom -= hypothesis.crop_transform[None, :, 0]
    distance = torch.tensor([[math.log(start.distance / model.distance) for start in starts]]) - zoom
    codes = hypothesis.instance.codes
    shape = spaces[0].coordinates(codes.shape)
    texture = spaces[1].coordinates(codes.texture)
    parameters = Parameters(angles, distance, zoom, hypothesis.crop_transform[None], shape[None], texture[None])
    return replace(HypothesisBatch.of(parameters), origin=torch.tensor([hypothesis.origin]))
