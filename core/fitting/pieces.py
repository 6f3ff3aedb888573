"""Rays of hypotheses in pieces for the thread pool."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import torch
from jaxtyping import Bool
from torch import Tensor

from core.runtime.pool import map_pieces

_SAMPLES, _MOST = 16384, 16
"""Samples of a piece, and pieces at most: threads share Python's lock, and with smaller pieces wait for it longer."""

Piece = tuple[slice, slice, slice]  # some hypotheses, views and rays: an index


def map_rays(function: Callable[[Piece], tuple[Tensor, ...]], shape: torch.Size, samples: int) -> tuple[Tensor, ...]:
    """Return a function's values for rays, (hypotheses, views, rays, ...), computed in pieces.

    Args:
        shape: numbers of hypotheses, views and rays.
        samples: of each ray.
    """
    count = min(_MOST, max(2, round(math.prod(shape) * samples / _SAMPLES)))
    pieces, whole = list(_split(shape[0], shape[2], count)), list[Tensor]()
    for piece, values in zip(pieces, map_pieces(function, pieces), strict=True):
        whole = whole or [value.new_empty(*shape, *value.shape[3:]) for value in values]
        for all_values, some in zip(whole, values, strict=True):
            all_values[piece] = some
    return tuple(whole)


def cells_of(cells: Bool[Tensor, "hypotheses_or_one x y z"] | None, some: slice) -> Bool[Tensor, "some x y z"] | None:
    """Return the cells of some hypotheses; cells of all objects are the same for each."""
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
