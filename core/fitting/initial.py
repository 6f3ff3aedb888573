"""Initial hypotheses: cameras of the view bank with shapes of its prototypes, or the state of an earlier fit.

Codes have local minima, so shapes compete like cameras do. Every camera of the view bank comes with the prototype whose
render from there is most similar to the photo. Known cameras come with several prototypes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from core.fitting.hypotheses import (
    MAX_ZOOM,
    Hypothesis,
    HypothesisBatch,
    Parameters,
    by_loss,
    clamp_parameters,
    suppress_neighbours,
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
    model, space = problem.model, problem.model.codes.shape_space
    candidates = {
        view: _candidates(problem, view, count, generator) for view in problem.unknown.nonzero()[:, 0].tolist()
    }
    count = min([count, *(len(found.azimuth) for found in candidates.values())])
    shape = torch.zeros(count, len(space.std))
    if not candidates:
        shape = nearest_shapes(problem, problem.cameras, count)
        count = len(shape)
    batch = HypothesisBatch.of(_at_cameras(model, problem.cameras, shape))
    parameters = batch.parameters
    if problem.settings.estimate_focal:
        zooms = torch.tensor(_INITIAL_ZOOMS).repeat_interleave(2).repeat(count)[:count]
        parameters.zoom[:, problem.unknown] = zooms[:, None]
    for view, found in candidates.items():
        _place(problem, view, parameters, found)
        if problem.bank and problem.components.prototype_shapes:
            prototypes = space.coordinates(problem.bank.shapes(model.codes))[found.prototype[:count]]
            parameters.shape.add_(_SHAPE_BLEND * prototypes / len(candidates))
    return batch


def _place(problem: Problem, view: int, parameters: Parameters, found: CandidateCameras) -> None:
    """Put the camera of one view of each hypothesis at a candidate, in place."""
    count, photo = len(parameters.angles), problem.photos[view]
    parameters.angles[:, view] = torch.stack((found.azimuth, found.elevation), -1)[:count]
    further = (found.distance[:count] / problem.model.distance).log()
    if not photo.scaled:
        # Objects differ in size too: the distance explains only what exceeds the tolerance.
        further = further - further.clamp(-_SIZE_TOLERANCE, _SIZE_TOLERANCE)
    if photo.cropped:
        parameters.crop_transform[:, view, 2:] = found.shift[:count]
    if photo.focal is not None:
        parameters.zoom[:, view] = min(math.log(photo.focal / problem.cameras[view].focal), MAX_ZOOM)
    if photo.cropped and photo.focal is None:
        parameters.crop_transform[:, view, 0] = -further
    else:
        parameters.distance[:, view] = further


def random_angles(count: int, generator: torch.Generator) -> Float[Tensor, "count 2"]:
    """Return azimuths and elevations (rad) uniform on the upper half of the sphere."""
    anywhere = torch.rand(count, 2, generator=generator)
    return torch.stack((2 * math.pi * anywhere[:, 0], anywhere[:, 1].asin()), -1)


def _candidates(problem: Problem, view: int, count: int, generator: torch.Generator) -> CandidateCameras:
    model, photo = problem.model, problem.photos[view]
    if problem.bank is None:
        azimuth, elevation = random_angles(count, generator).unbind(-1)
        distance, first = torch.full((count,), model.distance), torch.zeros(count, dtype=torch.long)
        return CandidateCameras(azimuth, elevation, distance, torch.zeros(count, 2), first)
    image = ObjectMask(photo.mask, problem.cameras[view].focal, photo.unseen)
    return rank_cameras(problem.bank, image, count, problem.viewpoints[view], photo.cropped)


def _at_cameras(model: Model, cameras: Sequence[Camera], shape: Float[Tensor, "count rank"]) -> Parameters:
    """Return parameters of shapes, each with the mean texture and the same cameras."""
    count, views = len(shape), len(cameras)
    angles = torch.tensor([(camera.azimuth, camera.elevation) for camera in cameras]).repeat(count, 1, 1)
    distance = torch.tensor([math.log(camera.distance / model.distance) for camera in cameras]).repeat(count, 1)
    texture = torch.zeros(count, len(model.codes.texture_space.std))
    return Parameters(angles, distance, torch.zeros_like(distance), torch.zeros(count, views, 4), shape, texture)


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
    others = (shapes.abs().amax(1) > _MIN_DIFFERENCE).nonzero()[:, 0]
    best = others[similarity[others].argsort(descending=True)[: count - 1]]
    return torch.cat((mean, _SHAPE_BLEND * shapes[best]))


def local_hypotheses(problem: Problem, batch: HypothesisBatch, count: int) -> HypothesisBatch:
    """Return at most ``count`` hypotheses at and around the best cameras (:data:`core.fitting.schedule.LOCAL_OFFSETS`).

    Codes are fresh: the mean texture, and :func:`nearest_shapes`. Without the component ``fresh_codes``, returns the
    batch itself.
    """
    if not problem.components.fresh_codes:
        return batch
    placed = []
    for index, offsets in zip(ordered(problem, batch).tolist(), LOCAL_OFFSETS, strict=False):
        cameras = to_cameras(problem.model, batch.parameters, index, problem.cameras)
        shapes = nearest_shapes(problem, cameras, max(most for *_, most in offsets))
        placed += [(rank, index, move, shape) for *move, most in offsets for rank, shape in enumerate(shapes[:most])]
    placed.sort(key=lambda one: one[0])  # if there are too many, every place keeps its best matching shapes
    _, indices, moves, shapes_there = zip(*placed[:count], strict=True)
    begin, unknown = batch[torch.tensor(indices)], problem.unknown
    angles = begin.parameters.angles + torch.tensor(moves).deg2rad()[:, None] * unknown[:, None]
    texture = torch.zeros_like(begin.parameters.texture)
    parameters = begin.parameters._replace(angles=angles, shape=torch.stack(shapes_there), texture=texture)
    return replace(begin, parameters=clamp_parameters(parameters, unknown))


def ordered(problem: Problem, batch: HypothesisBatch) -> Int[Tensor, "some"]:
    """Return the indices of finite hypotheses by loss: the best of each basin, then the others."""
    if problem.components.distinct_basins:
        return suppress_neighbours(batch, problem.unknown)
    return by_loss(batch)


def resume_from(
    model: Model,
    photos: Sequence[Photo],
    cameras: Sequence[Camera],
    found: Hypothesis,
    spaces: tuple[CodeSpace, CodeSpace],
) -> HypothesisBatch:
    """Return a single hypothesis in the state of an earlier fit, with the photos' own cameras where these are known.

    Args:
        cameras: see :func:`core.fitting.hypotheses.to_cameras`.
        found: result of the earlier fit.
        spaces: code spaces of shape and texture in which the fit searches.
    """
    at = [photo.camera or camera for photo, camera in zip(photos, found.cameras, strict=True)]
    angles = torch.tensor([[(camera.azimuth, camera.elevation) for camera in at]])
    zoom = torch.tensor([[math.log(one.focal / two.focal) for one, two in zip(at, cameras, strict=True)]])
    zoom -= found.crop_transform[None, :, 0]
    distance = torch.tensor([[math.log(camera.distance / model.distance) for camera in at]]) - zoom
    codes = found.instance.codes
    shape = spaces[0].coordinates(codes.shape)
    texture = spaces[1].coordinates(codes.texture)
    parameters = Parameters(angles, distance, zoom, found.crop_transform[None], shape[None], texture[None])
    return replace(HypothesisBatch.of(parameters), origin=torch.tensor([found.origin]))


def combine_views(parts: Sequence[tuple[list[int], HypothesisBatch]], views: int, count: int) -> HypothesisBatch:
    """Combine one hypothesis of every search; return the ``count`` combinations of least total loss.

    Args:
        parts: the photos of each search, and its remaining hypotheses.
        views: number of photos in all.
    """
    combinations: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    for _, batch in parts:
        losses = enumerate(batch.loss.tolist())
        longer = [(loss + more, (*taken, index)) for index, more in losses for loss, taken in combinations]
        combinations = sorted(longer)[:count]
    taken = torch.tensor([indices for _, indices in combinations])
    pairs = list(zip(parts, taken.unbind(1), strict=True))
    chosen = [Parameters(*(part[index] for part in batch.parameters)) for (_, batch), index in pairs]
    return HypothesisBatch.of(_merge_views([some for some, _ in parts], chosen, views))


def _merge_views(views_of: Sequence[list[int]], chosen: Sequence[Parameters], views: int) -> Parameters:
    """Return the cameras of all parts with the mean of their codes."""
    cameras = [part.new_zeros(len(part), views, *part.shape[2:]) for part in chosen[0][:4]]
    for some, parameters in zip(views_of, chosen, strict=True):
        for whole, part in zip(cameras, parameters[:4], strict=True):
            whole[:, some] = part
    means = [torch.stack(parts).mean(0) for parts in zip(*(parameters[4:] for parameters in chosen), strict=True)]
    return Parameters(*cameras, *means)
