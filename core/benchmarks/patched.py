"""Parts of the method taken out for a while, to see what they are worth."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple


class Change(NamedTuple):
    """Something that holds for a while."""

    owner: object
    """a module"""
    name: str
    value: object


@contextmanager
def changed(changes: Sequence[Change]) -> Iterator[None]:
    """Let changes hold inside a ``with``."""
    before = [getattr(change.owner, change.name) for change in changes]
    for change in changes:
        setattr(*change)
    try:
        yield
    finally:
        for change, value in zip(changes, before, strict=True):
            setattr(change.owner, change.name, value)
