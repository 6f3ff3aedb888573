"""The rays of hypotheses in pieces for the pool of threads."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import torch
from jaxtyping import Bool
from torch import Tensor

from core.geometry.rays import Rays
from core.runtime.pool import map_pieces

_PIECES = 8  # As many cores are kept busy. With more, calls cost more than two cores gain.


def map_rays(function: Callable[[slice, Rays], tuple[Tensor, ...]], rays: Rays) -> tuple[Tensor, ...]:
    """Return a function's values for rays, (hypotheses, views, rays, ...), from its values for pieces of them.

    Args:
        function: of some of the hypotheses and their rays, or some of these; returns values for each ray.
    """
    pieces, whole = list(_split(*rays.near.shape)), list[Tensor]()
    found = map_pieces(lambda piece: function(piece[0], rays[piece]), pieces)
    for piece, values in zip(pieces, found, strict=True):
        whole = whole or [value.new_empty(*rays.near.shape, *value.shape[3:]) for value in values]
        for all_values, some in zip(whole, values, strict=True):
            all_values[piece] = some
    return tuple(whole)


def cells_of(cells: Bool[Tensor, "hypotheses_or_one x y z"] | None, some: slice) -> Bool[Tensor, "some x y z"] | None:
    """Return the cells of some hypotheses; cells of all objects are the same for each."""
    return cells if cells is None or len(cells) == 1 else cells[some]


def _split(hypotheses: int, views: int, rays: int) -> Iterator[tuple[slice, slice, slice]]:
    """Pieces of equal size: some hypotheses where there are many, else some of their rays."""
    everything = slice(None)
    if hypotheses >= _PIECES:
        ends = torch.linspace(0, hypotheses, _PIECES + 1).round().int().tolist()
        yield from ((slice(*pair), everything, everything) for pair in pairwise(ends))
    else:  # every so manieth ray, as they come sorted: on the object, near it, elsewhere
        ways = min(_PIECES, rays)
        yield from ((everything, everything, slice(first, None, ways)) for first in range(ways))
