"""Zoom and distance at which the object fills the frame, for single cameras and for all views of a video."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from core.export.films import View
from core.geometry.camera import Camera
from core.models.model import Instance
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS, shape_occupancy
from core.runtime.modes import isolated

MARGIN = 0.04  # of the frame's width and height, left free on each side
_SHAPES = 6  # evenly spaced shapes of a video that are checked; shapes between are mixtures of these
_CAMERAS = 180  # cameras of a long video that are checked: two degrees of a turn apart
_MIN_OPACITY = 0.03  # of a cell that counts as part of the object; fainter haze is invisible at an edge
_PER_SIDE = 2  # points of an outline along each side of an occupied cell
_BLOCK = 16384
_NEAREST = 0.05  # scene units in front of the camera; closer points, or points behind, are moved there


@isolated
def filling_frame(views: Sequence[View]) -> list[View]:
    """Return the views with one common zoom at which the object just stays inside every frame.

    The zoom changes the focal length only, so the perspective stays.
    """
    step = max(1, math.ceil((len(views) - 1) / (_SHAPES - 1)))
    instances = {view.instance for view in [*views[::step], *views[-1:]]}
    points = torch.cat([_outline(instance) for instance in instances])
    zoom = min(_largest_zoom(view.camera, points) for view in [*views[:: -(-len(views) // _CAMERAS)], *views[-1:]])
    return [view._replace(camera=replace(view.camera, focal=zoom * view.camera.focal)) for view in views]


def filling_distance(instance: Instance, camera: Camera, fraction: float) -> float:
    """Return the distance (scene units) at which the object fills a fraction (0..1) of the frame's width or height."""
    local = instance.local_camera(camera).to_camera_axes(_opaque_points(instance, 1))
    reach = local[:, :2].abs() + max(instance.model.extent) / CELLS  # the points are the middles of cells
    half = fraction * torch.tensor([camera.width, camera.height]) / (2 * camera.focal)
    return camera.distance + float((reach / half + local[:, 2:]).amax())


def _largest_zoom(camera: Camera, points: Float[Tensor, "points 3"]) -> float:
    """Return the factor by which the focal length can grow until a point reaches the frame's margin."""
    local = camera.to_camera_axes(points)
    slopes = local[:, :2].abs() / (-local[:, 2:]).clamp_min(_NEAREST)
    half = torch.tensor([camera.width, camera.height]) / (2 * camera.focal)
    return float((1 - 2 * MARGIN) / (slopes / half).amax())


@lru_cache(maxsize=8)
def _outline(instance: Instance) -> Float[Tensor, "ends 3"]:
    """Return points of an object (scene units) with the same convex hull: both ends of its rows along each axis."""
    points = _opaque_points(instance, _PER_SIDE)
    cell = ((points - points.amin(0)) * (CELLS * _PER_SIDE / 2) / torch.tensor(instance.model.extent) + 0.5).long()
    taken = torch.zeros((cell.amax(0) + 1).tolist(), dtype=torch.bool)
    taken[cell.unbind(-1)] = True
    ends = taken
    for axis, side in enumerate(taken.shape):
        number = taken.cumsum(axis)
        ends = ends & ((number == 1) | (number == number.narrow(axis, side - 1, 1)))
    return points[ends[cell.unbind(-1)]] * torch.tensor(instance.codes.proportions or 1.0)


def _opaque_points(instance: Instance, per_side: int) -> Float[Tensor, "points 3"]:
    """Return opaque points (scene units), ``per_side`` along a cell's side; the box's corners if there are none."""
    model = instance.model
    folded = FoldedField.of(instance)
    occupancy = shape_occupancy(instance)
    points = occupancy.points_in(occupancy.cells.nonzero(), per_side)
    threshold = -math.log1p(-_MIN_OPACITY) / (2 * max(model.extent) / CELLS)
    with torch.inference_mode():
        blocks = [block[folded.density(block)[0] > threshold] for block in points.split(_BLOCK)]
    opaque = torch.cat(blocks).cpu() if blocks else torch.empty(0, 3)
    if len(opaque):
        return opaque
    return torch.cartesian_prod(*(torch.stack((-side, side)) for side in torch.tensor(model.extent)))
