"""Cameras whose frame the object fills: as near as all of it stays in sight, in every view of a video, or a share."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from core.export.keyframes import View
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.models.open_models import OpenModels, model_of
from core.rendering.fast import shape_occupancy
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS

MARGIN = 0.04  # of the frame's width and height, left free at either side at the least
_SHAPES = 6  # shapes of a video that are looked at, evenly spaced: those between them are mixtures of them
_CAMERAS = 180  # of a long video that are looked at: two degrees of a turn apart
_MIN_OPACITY = 0.03  # of a cell that counts as the object's: fainter ones are a haze that nobody sees at an edge
_PARTS = 2  # points along each side of an occupied cell, of an outline
_BLOCK = 16384
_NEAREST = 0.05  # scene units in front of the camera: what is nearer, or behind, counts as if it were there


def filling_frame(models: Model | OpenModels, views: Sequence[View], zoom_out: bool = True) -> list[View]:
    """The views with one zoom for all, by which the object just stays in every frame.

    The zoom changes the focal length: the perspective stays.

    Args:
        zoom_out: False only comes nearer, so that views which show a part of the object on purpose still do.
    """
    step = max(1, math.ceil((len(views) - 1) / (_SHAPES - 1)))
    shapes = {view.codes for view in [*views[::step], *views[-1:]]}
    points = torch.cat([_outline(model_of(models, codes), codes) for codes in shapes])
    zoom = min(_largest_zoom(view.camera, points) for view in [*views[:: -(-len(views) // _CAMERAS)], *views[-1:]])
    zoom = zoom if zoom_out else max(1.0, zoom)
    return [View(view.codes, replace(view.camera, focal=zoom * view.camera.focal)) for view in views]


def filling_distance(model: Model, codes: Codes, camera: Camera, share: float) -> float:
    """How far from the scene's origin (scene units) a camera of this direction and focal length sees the object fill a
    share (0..1) of the frame's width or height, whichever binds.
    """
    local = camera.to_camera_axes(_opaque_points(model, codes, 1))
    half = share * torch.tensor([camera.width, camera.height]) / (2 * camera.focal)
    return camera.distance + float((local[:, :2].abs() / half + local[:, 2:]).amax())


def _largest_zoom(camera: Camera, points: Float[Tensor, "points 3"]) -> float:
    """By how much the focal length can grow until a point comes too near to the frame's edge."""
    local = camera.to_camera_axes(points)
    slopes = local[:, :2].abs() / (-local[:, 2:]).clamp_min(_NEAREST)
    half = torch.tensor([camera.width, camera.height]) / (2 * camera.focal)
    return float((1 - 2 * MARGIN) / (slopes / half).amax())


@lru_cache(maxsize=8)
def _outline(model: Model, codes: Codes) -> Float[Tensor, "ends 3"]:
    """Points of an object (scene units) that end its rows along all three axes: its convex hull is theirs."""
    points = _opaque_points(model, codes, _PARTS)
    place = ((points - points.amin(0)) * (CELLS * _PARTS / 2) / torch.tensor(model.extent) + 0.5).long()
    taken = torch.zeros((place.amax(0) + 1).tolist(), dtype=torch.bool)
    taken[place.unbind(-1)] = True
    ends = taken
    for axis, side in enumerate(taken.shape):
        number = taken.cumsum(axis)
        ends = ends & ((number == 1) | (number == number.narrow(axis, side - 1, 1)))
    return points[ends[place.unbind(-1)]]


def _opaque_points(model: Model, codes: Codes, parts: int) -> Float[Tensor, "points 3"]:
    """Where an object is (scene units), so many points along each side of a cell; the corners of the model's box where
    it is nowhere opaque.
    """
    folded, occupancy = FoldedField(model, codes), shape_occupancy(model, tuple(codes.shape.tolist()))
    steps = (torch.arange(parts, device=model.device) + 0.5) / parts
    within = torch.cartesian_prod(steps, steps, steps)
    points = ((occupancy.cells.nonzero()[:, None] + within) * occupancy.cell - occupancy.extent).flatten(0, 1)
    least = -math.log1p(-_MIN_OPACITY) / (2 * max(model.extent) / CELLS)
    with torch.inference_mode():
        opaque = [part[folded.density(part)[0] > least] for part in points.split(_BLOCK)]
    found = torch.cat(opaque).cpu() if opaque else torch.empty(0, 3)
    return found if len(found) else _corners(model)


def _corners(model: Model) -> Float[Tensor, "8 3"]:
    return torch.cartesian_prod(*(torch.stack((-side, side)) for side in torch.tensor(model.extent)))
