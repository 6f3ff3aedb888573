"""Points on an object's surface, with their colours."""

import math
from functools import lru_cache
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from core.models.cells import contains, divide, with_neighbours
from core.models.model import Instance, Model
from core.rendering.folded_field import FoldedField
from core.runtime.layers import pad_rows

CELLS = 40  # along the longest side of the scene's box
_MIN_THICKNESS = 0.05  # optical depth of a cell with the density at a block's centre, above which the block is near
_INSIDE = 0.5  # optical depth of a cell with the density at its centre, above which it is inside the object
_CHUNK = 8192  # points evaluated at a time


class _Grid(NamedTuple):
    """Cell positions and first-layer activations shared by all objects of a model."""

    cell: float  # scene units
    points: Float[Tensor, "x y z 3"]  # centres of the cells
    activations: Float[Tensor, "cells width"]
    blocks: Bool[Tensor, "bx by bz"]  # blocks of 2x2x2 cells that any object of the model may occupy
    block_activations: Float[Tensor, "occupied width"]  # at these blocks' centres


def surface_points(instance: Instance) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Return points on an object's natural surface (scene units) and their colours (0..1).

    The points are centres of grid cells inside the object with a neighbour outside. Each is seen along its ray to the
    scene's origin. Empty for an empty object.
    """
    natural = instance.natural
    field = FoldedField.of(natural)
    is_moved = bool(natural.codes.space_edits)
    grid = _evaluated(field, instance.model, likely_only=False) if is_moved else _grid(instance.model)
    with torch.no_grad():
        # Cells of empty blocks with empty neighbours are not evaluated.
        dense = torch.zeros_like(grid.blocks)
        dense[grid.blocks] = _density(field, grid.block_activations) * grid.cell > _MIN_THICKNESS
        near = divide(with_neighbours(dense), 2)
        inside = torch.zeros_like(near)
        inside[near] = _density(field, grid.activations[near.flatten()]) * grid.cell > _INSIDE
        points = grid.points[inside & with_neighbours(~inside)]
        padded = pad_rows(points)
        features = field.density(padded)[1]
        colours = field.colour(features, field.direction_bias(-functional.normalize(padded, dim=-1)))
    return points, colours[: len(points)].clamp(0, 1)


@lru_cache(maxsize=1)
def _grid(model: Model) -> _Grid:
    return _evaluated(FoldedField(model.mean), model, likely_only=True)


@torch.no_grad()
def _evaluated(field: FoldedField, model: Model, likely_only: bool) -> _Grid:
    """Return a grid with first-layer activations; ``likely_only`` without blocks that no training object occupies."""
    extent = model.extent_tensor
    cell = 2 * float(extent.max()) / CELLS
    counts = [math.ceil(float(half) / cell) for half in extent]
    points = _centres([2 * count for count in counts], cell, extent.device)
    middles = _centres(counts, 2 * cell, extent.device)
    blocks = torch.ones(counts, dtype=torch.bool, device=extent.device)
    if likely_only and model.occupied_cells is not None:
        cells = model.occupied_cells[None].to(extent.device)
        blocks = contains(cells, middles.reshape(1, -1, 3), extent).reshape(counts)
    return _Grid(cell, points, field.first_layer(points.reshape(-1, 3)), blocks, field.first_layer(middles[blocks]))


def _centres(counts: list[int], step: float, device: torch.device) -> Float[Tensor, "x y z 3"]:
    """Return the centres of cells of side ``step``, in a grid centred at the origin."""
    axes = [(torch.arange(count, device=device) + 0.5 - count / 2) * step for count in counts]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)


def _density(field: FoldedField, activations: Float[Tensor, "points width"]) -> Float[Tensor, "points"]:
    chunks = activations.split(_CHUNK)
    return torch.cat([field.unbounded_density(pad_rows(chunk))[0][: len(chunk)] for chunk in chunks])
