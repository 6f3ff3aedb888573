"""A photo as input of a fit: its pixels in three strata (on the object, near it, elsewhere)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.ndimage import binary_fill_holes, distance_transform_edt
from torch import Tensor

from core.geometry.camera import pixel_centres
from core.geometry.pixels import bounding_box
from core.models.model import Model
from core.photos.photo import Photo

_STRATA_FRACTIONS = (0.5, 0.3, 0.2)  # of the rays: on the object, near it, elsewhere
_NEAR_MARGIN = 0.12  # distance from the mask that is near, relative to the object's size
_LEAST_CERTAINTY = 0.1  # of a pixel at an uncertain mask edge; not 0, since thin legs consist of edges
_SURE_EDGE = 0.3  # px of edge uncertainty below which all pixels are certain
_FOOTPRINT = 4  # rays through a pixel of a blurred photo


class PixelBatch(NamedTuple):
    """Some pixels of every photo, the same number of each."""

    pixels: Float[Tensor, "views rays 2"]  # from the middle of the photo, x right and y down, in focal lengths
    colours: Float[Tensor, "views rays 3"]  # on white, 0..1
    target_opacity: Float[Tensor, "views rays"]  # 1 on the object, 0 on the background
    mask_valid: Float[Tensor, "views rays"]
    """0 where the opacity is unknown: background enclosed by the object may be a white part of it; else 1"""
    certainty: Float[Tensor, "views rays"]  # weight of colour and opacity, 0..1: lower near uncertain mask edges
    footprints: Float[Tensor, "views rays rays_each 2"]  # focal lengths, offsets of the rays that a pixel averages
    weights: Float[Tensor, "views rays"]
    """fraction of the photo that each pixel represents: weighted sums estimate means over all pixels"""

    @property
    def points(self) -> Float[Tensor, "views all_rays 2"]:
        """Image points of all rays, those of a pixel in sequence, in the units of ``pixels``."""
        return (self.pixels[:, :, None] + self.footprints).flatten(1, 2)

    def subset(self, index: slice) -> "PixelBatch":
        """Return the pixels of a slice, weighted to estimate the same means."""
        batch = PixelBatch(*(values[:, index] for values in self))
        return batch._replace(weights=batch.weights * (self.pixels.shape[1] / batch.pixels.shape[1]))

    def mean_of_rays(self, values: Float[Tensor, "hypotheses views all_rays ..."]) -> Tensor:
        """Average the rays of each pixel: (hypotheses, views, all_rays, ...) to (hypotheses, views, rays, ...)."""
        rays = self.footprints.shape[2]
        return values if rays == 1 else values.unflatten(2, (-1, rays)).mean(3)


@dataclass(frozen=True, eq=False)
class Observation:
    """All pixels of a photo, row by row; fields as in :class:`PixelBatch`."""

    pixels: Float[Tensor, "pixels 2"]
    colours: Float[Tensor, "pixels 3"]
    target_opacity: Float[Tensor, "pixels"]
    mask_valid: Float[Tensor, "pixels"]
    certainty: Float[Tensor, "pixels"]
    blur: float  # focal lengths, standard deviation of the photo's blur
    strata: tuple[Int[Tensor, "_"], ...]
    """pixel indices on the object, near it, elsewhere; without unseen pixels beside the object, and empty strata"""
    fractions: tuple[float, ...]  # fraction of the sampled pixels for each stratum
    weight: float = 1.0  # of the photo; 0: it shows another object and is left out

    @classmethod
    def of(cls, photo: Photo, model: Model) -> "Observation":
        """Build from a photo. Raises ``ValueError`` if its mask is empty."""
        mask = photo.mask.cpu().numpy()
        if not mask.any():
            raise ValueError("the image shows no object: its mask is empty")
        height, width = mask.shape
        focal = photo.camera.focal if photo.camera is not None else model.focal * height / model.image_size
        middle = torch.tensor([width / 2 + model.pixel_offset, height / 2 + model.pixel_offset])
        pixels = (pixel_centres(width, height) - middle) / focal
        in_view = np.ones_like(mask) if photo.unseen is None else ~photo.unseen.cpu().numpy()
        strata, fractions = _strata(mask, in_view)
        enclosed = binary_fill_holes(mask) & ~mask
        return cls(
            pixels.reshape(-1, 2),
            photo.pixels.reshape(-1, 3).float().cpu(),
            (photo.mask if photo.opacity is None else photo.opacity).reshape(-1).float().cpu(),
            torch.from_numpy(~enclosed.ravel()).float(),
            torch.from_numpy(_certainty(mask, photo.edge_error).ravel()).float(),
            photo.blur / focal,
            strata,
            fractions,
        )

    def batch(self, index: Int[Tensor, "rays"]) -> PixelBatch:
        """Return some pixels of the photo, a ray each, weighted alike."""
        return PixelBatch(
            self.pixels[index][None],
            self.colours[index][None],
            self.target_opacity[index][None],
            self.mask_valid[index][None],
            self.weight * self.certainty[index][None],
            torch.zeros(1, len(index), 1, 2),
            torch.full((1, len(index)), self.weight / max(1, len(index))),
        )

    def sample(self, count: int, generator: torch.Generator) -> tuple[Int[Tensor, "rays"], Float[Tensor, "rays"]]:
        """Sample pixels evenly in each stratum; return their indices and :attr:`PixelBatch.weights`."""
        ends = np.rint(np.cumsum(self.fractions) * count).astype(int)
        counts = [max(1, int(n)) for n in np.diff(ends, prepend=0)]
        counts[0] = max(1, counts[0] + count - sum(counts))
        indices = []
        weights = []
        population = sum(map(len, self.strata))
        for stratum, number in zip(self.strata, counts, strict=True):
            slots = (torch.arange(number) + torch.rand(number, generator=generator)) / number
            indices.append(stratum[(slots * len(stratum)).long().clamp_max(len(stratum) - 1)])
            weights.append(torch.full((number,), self.weight * len(stratum) / (number * population)))
        return torch.cat(indices), torch.cat(weights)


def sample_pixels(observations: Sequence[Observation], count: int, generator: torch.Generator) -> PixelBatch:
    """Sample ``count`` pixels of every photo, at least one of each stratum.

    If any photo is blurred, samples half as many pixels of all photos, with four rays each.
    """
    blurred = any(observation.blur for observation in observations)
    count = max(count // (2 if blurred else 1), len(_STRATA_FRACTIONS))
    batches = []
    for observation in observations:
        index, weights = observation.sample(count, generator)
        batch = observation.batch(index)._replace(weights=weights[None])
        if blurred:
            batch = batch._replace(footprints=_footprints(observation.blur, count, generator)[None])
        batches.append(batch)
    return PixelBatch(*map(torch.cat, zip(*batches, strict=True)))


def _footprints(blur: float, count: int, generator: torch.Generator) -> Float[Tensor, "count rays_each 2"]:
    """Return the corners of randomly rotated squares whose variance is that of the blur, focal lengths."""
    turns = (torch.rand(count, 1, generator=generator) + torch.arange(_FOOTPRINT)) * (2 * math.pi / _FOOTPRINT)
    return blur * math.sqrt(2) * torch.stack((turns.cos(), turns.sin()), -1)


def _certainty(mask: np.ndarray, edge_error: float) -> np.ndarray:
    """Return the certainty of pixels, 0..1, by distance from the mask's edge.

    Args:
        edge_error: standard deviation of the edge's position, px.
    """
    if edge_error < _SURE_EDGE:
        return np.ones(mask.shape)
    distance = distance_transform_edt(mask) + distance_transform_edt(~mask) - 0.5
    return np.maximum(1 - np.exp(-((distance / edge_error) ** 2) / 2), _LEAST_CERTAINTY)


def _strata(mask: np.ndarray, in_view: np.ndarray) -> tuple[tuple[Tensor, ...], tuple[float, ...]]:
    """Return :attr:`Observation.strata` and :attr:`Observation.fractions`; ``in_view`` marks known background."""
    left, top, right, bottom = bounding_box(mask)
    size = max(right - left, bottom - top)
    near = distance_transform_edt(~mask) <= max(2.0, _NEAR_MARGIN * size)
    masks = (mask, near & ~mask & in_view, ~near & in_view)
    strata = [(stratum, fraction) for stratum, fraction in zip(masks, _STRATA_FRACTIONS, strict=True) if stratum.any()]
    total = sum(fraction for _, fraction in strata)
    indices = tuple(torch.from_numpy(np.flatnonzero(stratum.ravel())) for stratum, _ in strata)
    return indices, tuple(fraction / total for _, fraction in strata)
