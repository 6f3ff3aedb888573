"""Division of the rays of hypotheses into pieces for the thread pool."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import torch
from jaxtyping import Bool
from torch import Tensor

from core.runtime.pool import map_pieces

_PIECE_SAMPLES, _MAX_PIECES = 16384, 16
"""Samples of a piece, and the most pieces: with smaller pieces, threads wait longer for Python's lock."""

Piece = tuple[slice, slice, slice]  # index of some hypotheses, views and rays


def map_rays(function: Callable[[Piece], tuple[Tensor, ...]], shape: torch.Size, samples: int) -> tuple[Tensor, ...]:
    """Compute tensors of (hypotheses, views, rays, ...) in pieces, on the threads of the pool.

    Args:
        function: returns the part of each tensor for a piece.
        shape: numbers of hypotheses, views and rays.
        samples: intervals of each ray, for the size of pieces.
    """
    count = min(_MAX_PIECES, max(2, round(math.prod(shape) * samples / _PIECE_SAMPLES)))
    pieces, whole = list(_split(shape[0], shape[2], count)), list[Tensor]()
    for piece, values in zip(pieces, map_pieces(function, pieces), strict=True):
        whole = whole or [value.new_empty(*shape, *value.shape[3:]) for value in values]
        for all_values, some in zip(whole, values, strict=True):
            all_values[piece] = some
    return tuple(whole)


def cells_of(cells: Bool[Tensor, "hypotheses_or_one x y z"] | None, some: slice) -> Bool[Tensor, "some x y z"] | None:
    """Return the cells of some hypotheses; a single grid is that of every hypothesis."""
    return cells if cells is None or len(cells) == 1 else cells[some]


def _split(hypotheses: int, rays: int, count: int) -> Iterator[Piece]:
    """Split into pieces of equal size: by hypotheses if there are enough, else by rays."""
    everything = slice(None)
    if hypotheses >= 2 * count:
        ends = torch.linspace(0, hypotheses, count + 1).round().int().tolist()
        yield from ((slice(*pair), everything, everything) for pair in pairwise(ends))
    else:  # every n-th ray, as they are sorted: on the object, near it, elsewhere
        ways = min(count, rays)
        yield from ((everything, everything, slice(first, None, ways)) for first in range(ways))
