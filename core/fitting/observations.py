"""A picture as fitting uses it: its pixels sorted into the object, what is beside it, and the rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt, label
from torch import Tensor

from core.geometry.camera import pixel_centres
from core.models.model import Model
from core.photos.photo import Photo

_SHARES = (0.5, 0.3, 0.2)
"""of the rays: on the object, beside it, elsewhere"""
_BESIDE = 0.12
"""of the object's size: how far "beside" reaches"""


class Drawn(NamedTuple):
    """Some pixels of every picture."""

    places: Float[Tensor, "views rays 2"]
    """from the middle of the picture, x right and y down, in focal lengths"""
    colours: Float[Tensor, "views rays 3"]
    opaque: Float[Tensor, "views rays"]
    """1 on the object, 0 on the ground"""
    sure: Float[Tensor, "views rays"]
    """0 where the picture does not say whether it is opaque: ground that the object encloses may be a white part"""
    shares: Float[Tensor, "views rays"]
    """of the whole picture that each stands for: an average with these is an estimate over all its pixels"""


@dataclass(frozen=True, eq=False)
class Target:
    """A picture's pixels, flat; what they mean is said at :class:`Drawn`."""

    places: Float[Tensor, "pixels 2"]
    colours: Float[Tensor, "pixels 3"]
    opaque: Float[Tensor, "pixels"]
    sure: Float[Tensor, "pixels"]
    strata: tuple[Int[Tensor, "_"], ...]
    """indices of the pixels on the object, beside it, elsewhere; the ones that are there and were seen"""
    fractions: tuple[float, ...]
    """of the rays that each stratum gets"""

    @classmethod
    def of(cls, photo: Photo, model: Model) -> "Target":
        """Raises ``ValueError`` where the picture shows no object."""
        mask = photo.mask.cpu().numpy()
        if not mask.any():
            raise ValueError("the picture shows no object: its mask is empty")
        height, width = mask.shape
        focal = photo.camera.focal if photo.camera is not None else model.focal * height / model.image_size
        middle = torch.tensor([width / 2 + model.pixel_offset, height / 2 + model.pixel_offset])
        places = (pixel_centres(width, height) - middle) / focal
        seen = np.ones_like(mask) if photo.unseen is None else ~photo.unseen.cpu().numpy()
        strata, fractions = _strata(mask, seen)
        enclosed = ~mask & ~_joined_to_border(~mask)
        return cls(
            places.reshape(-1, 2),
            photo.pixels.reshape(-1, 3).float().cpu(),
            torch.from_numpy(mask.ravel()).float(),
            torch.from_numpy(~enclosed.ravel()).float(),
            strata,
            fractions,
        )

    def drawn(self, count: int, generator: torch.Generator) -> tuple[Int[Tensor, "rays"], Float[Tensor, "rays"]]:
        """Pixels spread evenly over each stratum, and the share of the picture that each stands for."""
        ends = np.rint(np.cumsum(self.fractions) * count).astype(int)
        counts = [max(1, int(n)) for n in np.diff(ends, prepend=0)]
        counts[0] = max(1, counts[0] + count - sum(counts))
        indices, shares, whole = [], [], sum(map(len, self.strata))
        for stratum, number in zip(self.strata, counts, strict=True):
            slots = (torch.arange(number) + torch.rand(number, generator=generator)) / number
            indices.append(stratum[(slots * len(stratum)).long().clamp_max(len(stratum) - 1)])
            shares.append(torch.full((number,), len(stratum) / (number * whole)))
        return torch.cat(indices), torch.cat(shares)


def draw(targets: Sequence[Target], count: int, generator: torch.Generator) -> Drawn:
    """``count`` pixels of every picture (at least one of each kind there is)."""
    count = max(count, len(_SHARES))
    parts = []
    for target in targets:
        index, shares = target.drawn(count, generator)
        values = (target.places, target.colours, target.opaque, target.sure)
        parts.append((*(value[index] for value in values), shares))
    return Drawn(*(torch.stack(part) for part in zip(*parts, strict=True)))


def _strata(mask: np.ndarray, seen: np.ndarray) -> tuple[tuple[Tensor, ...], tuple[float, ...]]:
    rows, columns = np.nonzero(mask)
    size = max(np.ptp(rows), np.ptp(columns)) + 1
    near = distance_transform_edt(~mask) <= max(2.0, _BESIDE * size)
    parts = [np.flatnonzero(part.ravel()) for part in (mask, near & ~mask & seen, ~near & seen)]
    there = [(torch.from_numpy(part), share) for part, share in zip(parts, _SHARES, strict=True) if len(part)]
    whole = sum(share for _, share in there)
    return tuple(part for part, _ in there), tuple(share / whole for _, share in there)


def _joined_to_border(ground: np.ndarray) -> np.ndarray:
    pieces, _ = label(np.pad(ground, 1, constant_values=True))
    return (pieces == pieces[0, 0])[1:-1, 1:-1]
