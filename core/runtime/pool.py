"""A pool of threads that compute pieces of work, each with one torch thread.

OpenMP splits every operation, and all threads wait for the slowest at its end: beside another busy program this is many
times slower than one thread. Here a thread computes a whole piece and then takes the next, so a busy core gets fewer
pieces. The pieces and their results, bit for bit, do not depend on the number of threads.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import TypeVar

import torch

from core.runtime.modes import TorchModes
from core.runtime.threads import thread_count

_Piece = TypeVar("_Piece")
_Result = TypeVar("_Result")
_AHEAD = 1.5  # pieces submitted per thread: few, as pieces of a more urgent job queue behind them


class _Caller(threading.local):
    """The pool of the current thread."""

    helps: bool = False  # the current thread belongs to a pool, so it gets none of its own
    count: int = 1  # threads of the pool
    helpers: ThreadPoolExecutor | None = None  # None: the current thread computes everything
    at_pause: Callable[[], None] | None = None  # called at every pause


_caller = _Caller()


def _forget_pools() -> None:
    """Start anew in a forked process, which has none of its parent's threads."""
    global _caller
    _caller = _Caller()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pools)


def at_pause(function: Callable[[], None] | None) -> None:
    """Set a function for the current thread to call at every :func:`pause`, such as work that a person waits for."""
    _caller.at_pause = function


def pause() -> None:
    """Let the current thread do more urgent work. Computations longer than about 30 ms call it, :func:`map_pieces` too.

    The work may run in the computation's modes of torch, so it sets its own.
    """
    if _caller.at_pause:
        _caller.at_pause()


def map_pieces(function: Callable[[_Piece], _Result], pieces: Iterable[_Piece]) -> Iterator[_Result]:
    """Yield ``function(piece)`` for each piece, in order; several are computed at a time.

    The threads compute a few pieces ahead of the value that is yielded. An exception is raised in place of its piece's
    result. A closed generator waits for the running pieces and starts no others. The threads start at the first call,
    with the caller's priority; every piece runs in the caller's gradient, inference and autocast modes. A nested call
    inside a piece runs in that piece's thread alone.

    Example:
        >>> list(map_pieces(lambda piece: piece.sum(), torch.arange(6).split(4)))
        [tensor(6), tensor(9)]
    """
    helpers = _helpers()
    if helpers is None:
        for piece in pieces:
            yield function(piece)
            pause()
        return
    remaining = iter(pieces)
    futures = deque[Future[_Result]]()
    try:
        while True:
            for piece in islice(remaining, int(_AHEAD * _caller.count) - len(futures)):
                futures.append(helpers.submit(TorchModes.current().applied()(function), piece))
            if not futures:
                return
            yield futures.popleft().result()
            pause()
    finally:
        for future in futures:
            future.cancel()
        wait(futures)


def _helpers() -> ThreadPoolExecutor | None:
    """Return the pool of the current thread, restarted if :func:`thread_count` has changed."""
    count = 1 if _caller.helps else thread_count()
    if count != _caller.count:
        if _caller.helpers:
            _caller.helpers.shutdown()
        _caller.count = count
        _caller.helpers = _started(count) if count > 1 else None
    return _caller.helpers


def _started(count: int) -> ThreadPoolExecutor | None:
    """Start the threads of a pool; None if there cannot be so many."""
    helpers = ThreadPoolExecutor(count, "pool", _begin)
    all_begun = threading.Barrier(count + 1)
    try:
        for _ in range(count):
            helpers.submit(all_begun.wait)
    except RuntimeError:  # the system grants no more threads
        all_begun.abort()
        helpers.shutdown(cancel_futures=True)
        return None
    all_begun.wait()
    # set_num_threads in a pool thread also changes the default of later threads, some of other libraries: restore it.
    torch.set_num_threads(torch.get_num_threads())
    return helpers


def _begin() -> None:
    torch.get_num_threads()  # the first query resets a thread's number to the program's,
    torch.set_num_threads(1)  # so it must come before this
    _caller.helps = True
