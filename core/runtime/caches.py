"""One byte-limited cache for renders and fits.

Holds visible intervals and occupied cells of shapes, and photo detail. Their sizes grow with the images, so the limit
is in bytes.
"""

from collections import OrderedDict
from collections.abc import Generator, Hashable
from enum import IntEnum
from threading import Lock
from typing import Any, NamedTuple, TypeVar

_Value = TypeVar("_Value")

LIMIT = 192 * 2**20  # bytes of all kinds together


class CacheKind(IntEnum):
    """Kinds of values, cheapest to recompute first.

    Values are evicted in this order, and the least recently used first within a kind. A value never evicts one of a
    later kind.
    """

    VIEW = 0  # visible intervals of a shape from a camera: large, recomputed in a fraction of a second
    SHAPE = 1  # occupied cells of a shape
    DETAIL = 2  # photo detail of codes


_MOST = {CacheKind.VIEW: 1.0, CacheKind.SHAPE: 3 / 4, CacheKind.DETAIL: 2 / 3}
"""Fraction of the limit that a kind and the later ones may fill: many shapes leave room for views."""


class Cached:
    """A value whose fields the cache counts."""


def byte_count(value: Any) -> int:
    """Return the bytes of the arrays in a value: itself, in tuples and lists, and in fields of :class:`Cached` values.

    An entry or field that occurs twice counts once.
    """
    if isinstance(value, Cached):
        return byte_count([*vars(value).values()])
    if isinstance(value, tuple | list):
        return sum(map(byte_count, {id(entry): entry for entry in value}.values()))
    return getattr(value, "nbytes", 0)


class _Entry(NamedTuple):
    value: Any
    size: int


class ByteCache:
    """Values by kind and key, limited by a number of bytes; thread-safe.

    Example:
        >>> cache = ByteCache(100)
        >>> for key in "abc":
        ...     cache.put(CacheKind.VIEW, key, key.upper(), 40)
        >>> cache.get(CacheKind.VIEW, "a"), cache.get(CacheKind.VIEW, "c"), cache.used
        (None, 'C', 80)
    """

    def __init__(self, limit: int = LIMIT) -> None:
        self.limit = limit
        self._entries: dict[CacheKind, OrderedDict[Hashable, _Entry]] = {kind: OrderedDict() for kind in CacheKind}
        self._lock = Lock()

    @property
    def used(self) -> int:
        """Bytes of all stored values."""
        with self._lock:
            return self._used()

    def get(self, kind: CacheKind, key: Hashable) -> Any:
        """Return a value and mark it as used; None if it is not stored."""
        with self._lock:
            entry = self._entries[kind].get(key)
            if entry is None:
                return None
            self._entries[kind].move_to_end(key)
            return entry.value

    def put(self, kind: CacheKind, key: Hashable, value: object, size: int) -> None:
        """Store a value of ``size`` bytes, evicting values of its kind and earlier kinds.

        A value that is too large is not stored.
        """
        with self._lock:
            self._entries[kind].pop(key, None)
            if size <= self._room(kind):
                self._make_room(kind, size)
                self._entries[kind][key] = _Entry(value, size)

    def kept(
        self, kind: CacheKind, key: Hashable, stream: Generator[None, None, _Value]
    ) -> Generator[None, None, _Value]:
        """Return a stored value, or the result of a stream, which is stored; yields as often as the stream."""
        value: _Value | None = self.get(kind, key)
        if value is None:
            value = yield from stream
            self.put(kind, key, value, byte_count(value))
        return value

    def make_room(self, kind: CacheKind, size: int) -> bool:
        """Evict until a value of ``size`` bytes fits, before computing it.

        Returns False, evicting nothing, if later kinds leave too little room.
        """
        with self._lock:
            if size > self._room(kind):
                return False
            self._make_room(kind, size)
            return True

    def newest(self, kind: CacheKind) -> list[tuple[Any, Any]]:
        """Return the keys and values of a kind, most recently used first."""
        with self._lock:
            return [(key, entry.value) for key, entry in reversed(self._entries[kind].items())]

    def clear(self, *kinds: CacheKind) -> None:
        """Remove all values of these kinds."""
        with self._lock:
            for kind in kinds:
                self._entries[kind].clear()

    def _used(self, first: int = CacheKind.VIEW) -> int:
        """Return the bytes of a kind and the later ones."""
        return sum(entry.size for kind in CacheKind if kind >= first for entry in self._entries[kind].values())

    def _room(self, kind: CacheKind) -> float:
        return self.limit * _MOST[kind] - self._used(kind + 1)

    def _make_room(self, kind: CacheKind, size: int) -> None:
        for first in reversed([earlier for earlier in CacheKind if earlier <= kind]):
            while self._used(first) + size > self.limit * _MOST[first]:
                lowest = next(later for later in CacheKind if later >= first and self._entries[later])
                self._entries[lowest].popitem(last=False)


CACHE = ByteCache()  # shared by rendering and fits of this process
