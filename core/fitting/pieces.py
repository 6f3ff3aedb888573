"""Division of the rays of hypotheses into pieces for the thread pool."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import torch
from jaxtyping import Bool
from torch import Tensor

from core.runtime.pool import map_pieces

_PIECE_SAMPLES = 65536  # of a piece; with smaller pieces, threads wait longer for Python's lock
_MAX_PIECES = 16

Piece = tuple[slice, slice, slice]  # index of some hypotheses, views and rays


def map_rays(function: Callable[[Piece], tuple[Tensor, ...]], shape: torch.Size, samples: int) -> tuple[Tensor, ...]:
    """Compute tensors of (hypotheses, views, rays, ...) in pieces, on the threads of the pool.

    Args:
        function: returns the part of each tensor for a piece.
        shape: numbers of hypotheses, views and rays.
        samples: intervals of each ray, for the size of pieces.
    """
    count = min(_MAX_PIECES, max(2, round(math.prod(shape) * samples / _PIECE_SAMPLES)))
    pieces = list(_split(shape[0], shape[2], count))
    results = list[Tensor]()
    for piece, piece_values in zip(pieces, map_pieces(function, pieces), strict=True):
        results = results or [values.new_empty(*shape, *values.shape[3:]) for values in piece_values]
        for result, values in zip(results, piece_values, strict=True):
            result[piece] = values
    return tuple(results)


def cells_of(
    cells: Bool[Tensor, "hypotheses_or_one x y z"] | None, hypotheses: slice
) -> Bool[Tensor, "selected x y z"] | None:
    """Return the cells of a slice of hypotheses; a single grid is that of every hypothesis."""
    return cells if cells is None or len(cells) == 1 else cells[hypotheses]


def _split(hypotheses: int, rays: int, count: int) -> Iterator[Piece]:
    """Split into pieces of equal size: by hypotheses if there are enough, else by rays."""
    everything = slice(None)
    if hypotheses >= 2 * count:
        ends = torch.linspace(0, hypotheses, count + 1).round().int().tolist()
        yield from ((slice(*pair), everything, everything) for pair in pairwise(ends))
    else:  # every n-th ray, as they are sorted: on the object, near it, elsewhere
        ways = min(count, rays)
        yield from ((everything, everything, slice(first, None, ways)) for first in range(ways))
