"""Generators that end with a result: run to the end, or mapped into the progress of a longer one."""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

_Result = TypeVar("_Result")


def run_to_end(stream: Generator[Any, None, _Result], receive: Callable[[Any], object] = lambda _: None) -> _Result:
    """Run a generator to its end and return its result; call ``receive`` with every value that it yields.

    Example:
        >>> def job():
        ...     yield 0.5
        ...     return "done"
        >>> run_to_end(job())
        'done'
    """
    while True:
        try:
            receive(next(stream))
        except StopIteration as done:
            return done.value


def subprogress(
    stream: Generator[float | None, None, _Result], begin: float, end: float
) -> Generator[float, None, _Result]:
    """Map a generator's fractions from 0..1 to ``begin``..``end`` and return its result; None counts as 0.

    Example:
        >>> def job():
        ...     yield 0.5
        ...     yield 1.0
        >>> list(subprogress(job(), 0.2, 0.4))
        [0.30000000000000004, 0.4]
    """
    while True:
        try:
            fraction = next(stream)
        except StopIteration as done:
            return done.value
        yield begin + (end - begin) * (fraction or 0.0)
