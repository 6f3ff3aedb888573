"""An object's field as a 3D texture, drawn by OpenGL (:mod:`core.gl.baked_shader`).

The texture stores logits (before softplus and contrast). Interpolating logits linearly is 3 to 6 dB better than
interpolating density, and edges stay crisp on coarse grids. :mod:`core.gl.baking` fills the texture.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from core.detail.lookup import DetailMaps
from core.geometry.camera import Factors
from core.models.field_config import FieldConfig
from core.rendering.ground_shadow import GroundShadow
from core.runtime.caches import Cached

LOGITS = -8.0, 24.0  # logits that bytes 0 and 255 stand for; -8 is a density of 0.01 per scene unit
STEPS_PER_TEXEL = 1.5  # samples of a ray; crisp densities lose 3 dB with 0.7, and more adds nothing
MIN_LIGHT = 0.005  # fraction of its light below which a ray ends; the rest counts as absorbed
_MAX_DISTANCE = 8  # largest distance stored, so the most cells that a ray skips at a time


@dataclass(frozen=True, eq=False)
class BakedField(Cached):
    """Colour and density at the corners of a grid, and its occupied cells. Not modified after creation."""

    texels: UInt8[np.ndarray, "x y z 4"]
    """rgb, and the logit of density as a byte (:data:`LOGITS`); only the occupied part of the grid"""
    distance: UInt8[np.ndarray, "cells cells cells"]
    """for each occupancy cell, the distance from :func:`cell_distances`; 0: the cell is occupied"""
    extent: tuple[float, float, float]  # half the size of the scene's box, scene units
    config: FieldConfig  # the field's: how density follows from logits
    pixel_offset: float  # px, shift of rays to the left and up of pixel centres
    cells: int  # cells of the texel grid along each axis of the box; the outermost corners lie on the box's faces
    first: tuple[int, int, int] = (0, 0, 0)  # grid corner of the first texel
    detail: DetailMaps | None = None  # photo detail, evaluated per pixel since it is far finer than texels
    shadow: GroundShadow | None = None  # the object's shadow on the ground, to be drawn over a background
    proportions: Factors | None = None  # of space when it is drawn (:attr:`core.models.codes.Codes.proportions`)

    def stretched(self, proportions: Factors | None) -> "BakedField":
        """Return the field of a natural object stretched along the axes: the same texels."""
        detail = self.detail and replace(self.detail, proportions=proportions)
        shadow = self.shadow and self.shadow.stretched(proportions)
        return replace(self, proportions=proportions, detail=detail, shadow=shadow)

    @property
    def step(self) -> float:
        """Distance between the samples of a ray, scene units."""
        return 2 * max(self.extent) / (STEPS_PER_TEXEL * self.cells)


def colour_texels(colour: Float[Tensor, "*corners 3"]) -> UInt8[Tensor, "*corners 3"]:
    """Convert colours to bytes, clamped to 0..1."""
    return (255 * colour.clamp(0, 1) + 0.5).to(torch.uint8)


def logit_texels(logits: Float[Tensor, "*corners"]) -> UInt8[Tensor, "*corners"]:
    """Convert logits to bytes, clamped to :data:`LOGITS`."""
    lowest, highest = LOGITS
    return (255 * ((logits - lowest) / (highest - lowest)).clamp(0, 1) + 0.5).to(torch.uint8)


def cell_distances(cells: Bool[Tensor, "x y z"]) -> UInt8[np.ndarray, "x y z"]:
    """Return the distance from each cell to the nearest occupied cell: cells in the maximum norm, at most 8."""
    from scipy.ndimage import distance_transform_cdt

    distance = distance_transform_cdt(~cells.cpu().numpy(), "chessboard")  # -1 without an occupied cell
    return np.where(distance < 0, _MAX_DISTANCE, distance.clip(max=_MAX_DISTANCE)).astype(np.uint8)
