"""Helpers for generators that end with a result: run to the end, or as part of a longer stream."""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

_Result = TypeVar("_Result")


def run_to_end(stream: Generator[Any, None, _Result], each: Callable[[Any], object] = lambda value: None) -> _Result:
    """Run a generator to its end and return its result; ``each`` is called with every value before.

    Example:
        >>> def job():
        ...     yield 0.5
        ...     return "done"
        >>> run_to_end(job())
        'done'
    """
    while True:
        try:
            each(next(stream))
        except StopIteration as done:
            return done.value


def subprogress(
    stream: Generator[float | None, None, _Result], begin: float, end: float
) -> Generator[float, None, _Result]:
    """Map a stream of fractions from 0..1 to ``begin``..``end`` of a longer one; None counts as 0.

    Example:
        >>> def job():
        ...     yield 0.5
        ...     yield 1.0
        >>> list(subprogress(job(), 0.2, 0.4))
        [0.30000000000000004, 0.4]
    """
    while True:
        try:
            share = next(stream)
        except StopIteration as done:
            return done.value
        yield begin + (end - begin) * (share or 0.0)
