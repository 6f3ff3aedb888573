"""An object baked for the cameras of a video: density once, colours as each camera sees them.

What the view changes of a colour is far more than what a fine grid loses: one texture for all views is 35 to 40 dB from
the exact render, however fine. Colours are therefore evaluated for a camera, of the corners alone that it may see;
between two cameras that are a few degrees apart they are mixed (:func:`mixed`).
"""

from collections.abc import Generator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn import functional

from core.geometry.camera import Camera
from core.models.cells import unravelled
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.baked_field import BakedField, cell_corners, cell_distances, colour_texels, logit_texels
from core.rendering.folded_field import FoldedField
from core.rendering.occupancy import CELLS

_BLOCK = 8192
"""Corners evaluated at a time: what another job waits for."""
_MIN_DENSITY = 0.5
"""per scene unit: a cell with less at all of its corners takes less than a hundredth of the light, and is empty; what
has no neighbour with more needs no colour"""
_BELOW = 6.0
"""optical depth: what lies deeper than that along all axes is seen by no camera"""
_BEHIND = 12.0
"""optical depth: what lies behind more than that is not coloured for a camera"""
_VOXEL = 2
"""texels along each side of a voxel, which hides what is behind it"""
_AHEAD, _LOOK = 3.0, 16
"""voxels: from where on, and how many, are looked at between one and the camera"""


class Box(NamedTuple):
    """A part of the grid of corners, from the first to before the end."""

    first: tuple[int, int, int]
    end: tuple[int, int, int]

    @property
    def sides(self) -> tuple[int, int, int]:
        """Corners along each axis."""
        x, y, z = (end - first for first, end in zip(*self, strict=True))
        return x, y, z


def box_of(occupied: Bool[Tensor, "x y z"], cells: int) -> Box:
    """The corners of a grid of so many cells that those occupied ones of the 64 have; all where none is."""
    found = occupied.nonzero().cpu()
    low, high = (found.amin(0), found.amax(0) + 1) if len(found) else (torch.zeros(3), torch.full((3,), CELLS))
    scale = cells // CELLS
    first, end = ((scale * low).int().tolist(), (scale * high + 1).int().tolist())
    return Box((first[0], first[1], first[2]), (end[0], end[1], end[2]))


class BakedObject:
    """The density of an object at the corners of a grid, and what colours need where a camera may see it."""

    def __init__(self, model: Model, codes: Codes, cells: int, box: Box) -> None:
        self._model, self._folded, self._cells, self._box = model, FoldedField(model, codes), cells, box
        self._extent, self._first = torch.tensor(model.extent), torch.tensor(box.first)

    def bake(self, occupied: Bool[Tensor, "x y z"]) -> Generator[None, None, None]:
        """Evaluate densities in the occupied cells, and features at the surface; yields after a few thousand corners.

        To be run to its end before anything else is asked of it.
        """
        density = torch.zeros(self._box.sides)
        corners = cell_corners(occupied, self._cells // CELLS).cpu()
        places = unravelled(corners, self._cells + 1) - self._first
        for part in places.split(_BLOCK):
            density[part.unbind(-1)] = self._density(part)[0].cpu()
            yield
        self._logits = logit_texels(density, self._model.field.config.density_scale)
        thickness = density * (2 * max(self._model.extent) / self._cells)
        self._voxels = _VOXEL * functional.avg_pool3d(thickness[None], _VOXEL, ceil_mode=True)[0]
        seen = _surface(density, thickness)
        self._shown = functional.max_pool3d(seen[None].float(), _VOXEL, ceil_mode=True)[0] > 0
        self._corners, features = seen.nonzero(), list[Tensor]()
        for part in self._corners.split(_BLOCK):
            features.append(self._density(part)[1])
            yield
        self._features = torch.cat(features) if features else torch.empty(0)
        self.distance: UInt8[np.ndarray, "cells cells cells"] = cell_distances(self._filled_cells(density))

    def seen_from(self, camera: Camera, before: BakedField | None = None) -> Generator[None, None, BakedField]:
        """The field in the colours that a camera sees; yields after every few thousand corners.

        Args:
            before: the same as seen from a camera nearby, which has the colours of what this one does not see; without
                it they are evaluated too.
        """
        model, origin = self._model, camera.pose()[:3, 3].float()
        if before is None:
            texels, shown = torch.zeros(*self._box.sides, 4, dtype=torch.uint8), torch.arange(len(self._corners))
        else:
            texels = torch.from_numpy(before.texels).clone()
            shown = self._in_sight(origin)[(self._corners // _VOXEL).unbind(-1)].nonzero()[:, 0]
        texels[..., 3] = self._logits
        for part in shown.split(_BLOCK):
            corners = self._corners[part]
            with torch.inference_mode():
                towards = functional.normalize(self._world(corners) - origin, dim=-1).to(self._folded.device)
                features = self._features.index_select(0, part.to(self._folded.device))
                colour = self._folded.colour(features, self._folded.direction_bias(towards))
            texels[..., :3][corners.unbind(-1)] = colour_texels(colour).cpu()
            yield
        about = model.extent, model.field.config.density_scale, model.pixel_offset, self._cells, self._box.first
        return BakedField(texels.numpy(), self.distance, *about)

    def _world(self, corners: Int[Tensor, "corners 3"]) -> Float[Tensor, "corners 3"]:
        return (corners + self._first) * (2 * self._extent / self._cells) - self._extent

    def _density(self, corners: Int[Tensor, "corners 3"]) -> tuple[Tensor, Tensor]:
        with torch.inference_mode():
            return self._folded.density(self._folded.first_layer(self._world(corners).to(self._folded.device)))

    def _filled_cells(self, density: Float[Tensor, "x y z"]) -> Bool[Tensor, "cells cells cells"]:
        """Which of the scene's cells hold enough at a corner to be drawn."""
        side = self._cells // CELLS
        most = functional.max_pool3d(density[None], side + 1, side)[0]
        filled = torch.zeros((CELLS,) * 3, dtype=torch.bool)
        x, y, z = (slice(at // side, at // side + count) for at, count in zip(self._box.first, most.shape, strict=True))
        filled[x, y, z] = most > _MIN_DENSITY
        return filled

    def _in_sight(self, origin: Float[Tensor, "3"]) -> Bool[Tensor, "x y z"]:
        """Which voxels at the surface have little between them and the camera."""
        size = 2 * self._extent * _VOXEL / self._cells
        voxel = self._shown.nonzero()
        place = voxel + 0.5
        towards = origin - (place * size + self._first * (size / _VOXEL) - self._extent)
        step = functional.normalize(towards, dim=-1) * size.max() / size
        around = functional.pad(self._voxels, (1,) * 6)
        depth, last, strides = torch.zeros(len(place)), torch.tensor(around.shape) - 1, torch.tensor(around.stride())
        for index in range(_LOOK):
            at = (place + step * (_AHEAD + index) + 1).long().clamp_min(0).minimum(last)
            depth += around.view(-1)[(at * strides).sum(-1)]
        found = torch.zeros_like(self._shown)
        found[voxel.unbind(-1)] = depth < _BEHIND
        return found


def mixed(first: BakedField, second: BakedField, share: float) -> BakedField:
    """A field between two of the same grid; ``share`` is the second's, 0..1."""
    if share <= 0 or share >= 1:
        return first if share <= 0 else second
    weight = round(256 * share)
    texels = (first.texels.astype(np.uint16) * (256 - weight) + second.texels.astype(np.uint16) * weight + 128) >> 8
    distance = first.distance if first.distance is second.distance else np.minimum(first.distance, second.distance)
    return replace(first, texels=texels.astype(np.uint8), distance=distance)


def _surface(density: Float[Tensor, "x y z"], thickness: Float[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """Which corners a camera may see: beside something, and not deep within, along an axis at least."""
    deep = torch.full_like(thickness, torch.inf)
    for axis in range(3):
        through = thickness.cumsum(axis)
        before, after = through - thickness, through.select(axis, -1).unsqueeze(axis) - through
        deep = torch.minimum(deep, torch.minimum(before, after))
    near = functional.max_pool3d((density > _MIN_DENSITY)[None].float(), 3, 1, 1)[0] > 0
    return near & (deep < _BELOW)
