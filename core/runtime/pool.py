"""A pool of threads that compute pieces of work, each with one torch thread.

OpenMP splits every operation, and all threads wait for the slowest at its end: beside another busy program this is many
times slower than one thread. Here a thread computes a whole piece and takes the next when it is free, so a busy core
takes fewer. Pieces, the order of results, and the results bit for bit do not depend on the number of threads.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import TypeVar

import torch

from core.runtime.threads import thread_count

_Piece = TypeVar("_Piece")
_Result = TypeVar("_Result")
_AHEAD = 1.5  # Pieces handed out for each thread: few wait, as a more urgent caller's come behind them.


class _Caller(threading.local):
    """The threads that work for this thread."""

    helps: bool = False  # this thread works for another one, so it has none
    count: int = 1
    helpers: ThreadPoolExecutor | None = None  # None: the thread computes by itself


_caller = _Caller()


def map_pieces(function: Callable[[_Piece], _Result], pieces: Iterable[_Piece]) -> Iterator[_Result]:
    """Yield ``function(piece)`` for each piece, in order; several are computed at a time.

    A few more pieces may run between two values. An exception is raised in place of its piece's result. A closed
    generator waits for the running pieces and starts no others. The threads start at the first call with the caller's
    priority, and inherit its gradient, inference and autocast modes. A piece that maps pieces itself computes these
    alone.

    Example:
        >>> list(map_pieces(lambda piece: piece.sum(), torch.arange(6).split(4)))
        [tensor(6), tensor(9)]
    """
    helpers = _helpers()
    if helpers is None:
        yield from map(function, pieces)
        return
    most, remaining, begun = int(_AHEAD * _caller.count), iter(pieces), deque[Future[_Result]]()
    try:
        while True:
            for piece in islice(remaining, most - len(begun)):
                begun.append(helpers.submit(_in_modes(function), piece))
            if not begun:
                return
            yield begun.popleft().result()
    finally:
        for future in begun:
            future.cancel()
        wait(begun)


def _helpers() -> ThreadPoolExecutor | None:
    """Return the threads that work for this one, in the current number."""
    count = 1 if _caller.helps else thread_count()
    if count != _caller.count:
        if _caller.helpers:
            _caller.helpers.shutdown()
        _caller.count, _caller.helpers = count, _started(count) if count > 1 else None
    return _caller.helpers


def _started(count: int) -> ThreadPoolExecutor:
    helpers, all_begun = ThreadPoolExecutor(count, "pool", _begin), threading.Barrier(count + 1)
    for _ in range(count):
        helpers.submit(all_begun.wait)
    all_begun.wait()
    # A thread that sets its own number also sets that of later threads, not all of which belong to this project.
    torch.set_num_threads(torch.get_num_threads())
    return helpers


def _begin() -> None:
    torch.get_num_threads()  # A thread's number is that of the program when it is first asked for,
    torch.set_num_threads(1)  # and only then its own.
    _caller.helps = True


def _in_modes(function: Callable[[_Piece], _Result]) -> Callable[[_Piece], _Result]:
    """Bind the caller's modes to the function: torch keeps them per thread."""
    inference, grad = torch.is_inference_mode_enabled(), torch.is_grad_enabled()
    autocast, dtype = torch.is_autocast_enabled("cpu"), torch.get_autocast_dtype("cpu")

    def run(piece: _Piece) -> _Result:
        with (
            torch.inference_mode(inference),
            torch.set_grad_enabled(grad),
            torch.autocast("cpu", enabled=autocast, dtype=dtype),
        ):
            return function(piece)

    return run
