"""The view bank: small views of a model's prototypes from all sides, used to rank cameras for a photo.

Every view is normalised to its bounding box, so a match gives the direction independent of the size; the ratio of the
sizes then gives the distance. :mod:`core.photos.view_bank` builds banks.
"""

import lzma
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped, UInt8
from torch import Tensor

from core.classifiers.viewpoint import directions
from core.models.codes import CodeBook

SIDE = 24  # px, of a view
_BYTES = SIDE * SIDE // 8  # of a view
_MOST_PROTOTYPES = 10_000  # in a file
_MOST_MEMORY = 64 * 2**20  # bytes to decompress with
_PACKED, _SIZES, _OFFSETS, _PROTOTYPES = "silhouettes", "sizes", "offsets", "prototypes"  # tensors in files


@dataclass(frozen=True, eq=False)
class ViewBank:
    """Small views of prototypes from :func:`core.classifiers.viewpoint.directions`, normalised to their bounding boxes.

    Raises ``ValueError`` for parts that do not match.
    """

    prototypes: Int[Tensor, "prototypes"]  # rows of the model's shape codes; -1: their mean
    distance: float  # scene units, of all views
    silhouettes: UInt8[Tensor, "prototypes views bytes"]
    """masks, pixels row by row, eight to a byte, the lowest bit first"""
    sizes: Float[Tensor, "prototypes views"]  # longer side of the bounding box, in focal lengths
    offsets: Float[Tensor, "prototypes views 2"]
    """middle of the bounding box (x, y) relative to the image's, in focal lengths"""

    def __post_init__(self) -> None:
        count = len(self.prototypes), len(self.azimuth)
        shapes = [tensor.shape for tensor in (self.silhouettes, self.sizes, self.offsets)]
        if shapes != [(*count, _BYTES), count, (*count, 2)]:
            raise ValueError(f"the parts of a view bank do not fit {count[0]} prototypes")
        finite = bool(self.sizes.isfinite().all() and self.offsets.isfinite().all())
        if not (finite and 0 < self.distance < math.inf):
            raise ValueError("the numbers of a view bank must be finite")

    @property
    def azimuth(self) -> Float[Tensor, "views"]:
        """rad"""
        return directions()[0]

    @property
    def elevation(self) -> Float[Tensor, "views"]:
        """rad"""
        return directions()[1]

    @property
    def is_empty(self) -> bool:
        """The bank has no prototypes, as the model renders nothing."""
        return not len(self.prototypes)

    def require_prototypes(self) -> None:
        """Raise ``ValueError`` if the bank is empty."""
        if self.is_empty:
            raise ValueError("the model shows no objects: all of its prototypes are empty")

    def fits(self, codes: CodeBook) -> bool:
        """Return whether the code book has all prototypes."""
        return bool(((self.prototypes >= -1) & (self.prototypes < len(codes.shapes))).all())

    def shapes(self, codes: CodeBook) -> Float[Tensor, "prototypes latent"]:
        """Return the prototypes' shape codes from the model's code book."""
        return torch.cat((codes.shapes, codes.shape_space.mean[None]))[self.prototypes]

    def to_tensors(self) -> dict[str, Shaped[Tensor, "..."]]:
        """Return the bank for a model file: silhouettes compressed (a third), sizes and offsets in half precision."""
        packed = bytearray(lzma.compress(self.silhouettes.numpy().tobytes()))
        return {
            _PROTOTYPES: self.prototypes,
            _PACKED: torch.frombuffer(packed, dtype=torch.uint8),
            _SIZES: self.sizes.half(),
            _OFFSETS: self.offsets.half(),
        }

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, Tensor], distance: float) -> "ViewBank":
        """Invert :meth:`to_tensors` for a model with this camera distance (scene units).

        Raises ``ValueError`` for anything else, such as silhouettes of more or fewer prototypes.
        """
        prototypes = tensors[_PROTOTYPES].long()
        if prototypes.ndim != 1 or len(prototypes) > _MOST_PROTOTYPES:
            raise ValueError(f"a view bank has at most {_MOST_PROTOTYPES} prototypes")
        shape = len(prototypes), len(directions()[0]), _BYTES
        try:
            packed = tensors[_PACKED].numpy().tobytes()
            views = lzma.LZMADecompressor(memlimit=_MOST_MEMORY).decompress(packed, math.prod(shape) + 1)
        except lzma.LZMAError as error:
            raise ValueError(f"the silhouettes of the view bank are damaged ({error})") from None
        if len(views) != math.prod(shape):
            raise ValueError(f"the parts of a view bank do not fit {len(prototypes)} prototypes")
        silhouettes = torch.from_numpy(np.frombuffer(views, np.uint8).reshape(shape).copy())
        return cls(prototypes, distance, silhouettes, tensors[_SIZES].float(), tensors[_OFFSETS].float())


def unpack_bits(packed: UInt8[Tensor, "views bytes"]) -> Float[Tensor, "views pixels"]:
    """Unpack the masks (0 or 1) of :attr:`ViewBank.silhouettes`."""
    return torch.from_numpy(np.unpackbits(packed.numpy(), axis=-1, bitorder="little")).float()
