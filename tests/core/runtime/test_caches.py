"""The cache stays below its limit and evicts the values that are cheapest to recompute first."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.runtime.caches import ByteCache, Cached, CacheKind, byte_count
from core.streams import run_to_end

puts = st.lists(st.tuples(st.sampled_from(list(CacheKind)), st.integers(0, 9), st.integers(0, 130)), max_size=40)

LIMITS = {CacheKind.VIEW: 100, CacheKind.SHAPE: 75, CacheKind.DETAIL: 200 / 3}  # bytes of a kind and the later ones


def stored(cache: ByteCache, first: int) -> int:
    """Bytes of a kind and the later ones; values are their own sizes."""
    return sum(size for kind in CacheKind if kind >= first for _, size in cache.newest(kind))


@given(puts)
def test_the_limits_hold(puts: list[tuple[CacheKind, int, int]]):
    cache = ByteCache(100)
    for kind, key, size in puts:
        room = LIMITS[kind] - stored(cache, kind + 1)
        cache.put(kind, key, size, size)
        assert cache.get(kind, key) == (size if size <= room else None)
        assert all(stored(cache, first) <= limit for first, limit in LIMITS.items())
        assert cache.used == stored(cache, CacheKind.VIEW)


@given(puts)
def test_make_room_evicts_until_the_value_fits(puts: list[tuple[CacheKind, int, int]]):
    cache = ByteCache(100)
    for kind, key, size in puts:
        cache.put(kind, key, size, size)
        used = cache.used
        if cache.make_room(CacheKind.VIEW, 40):
            assert cache.used <= 60
        else:
            assert cache.used == used and stored(cache, CacheKind.SHAPE) > 60


@dataclass
class Holder(Cached):
    arrays: tuple[np.ndarray, ...]
    field: object


def test_bytes_of_arrays_in_fields_are_counted_once():
    array = np.zeros(10, np.uint8)
    assert byte_count(Holder((array, array), Holder((), array))) == 20
    assert byte_count([(array,), "no array", Holder((array[:3],), object())]) == 13


def test_the_result_of_a_stream_is_kept():
    def stream() -> Generator[None, None, np.ndarray]:
        yield None
        return np.zeros(30, np.uint8)

    cache = ByteCache(100)
    first = run_to_end(cache.kept(CacheKind.VIEW, "a", stream()))
    assert run_to_end(cache.kept(CacheKind.VIEW, "a", stream())) is first
    assert list(cache.kept(CacheKind.VIEW, "a", stream())) == [] and cache.used == 30


def test_many_shapes_leave_a_quarter_to_views():
    cache = ByteCache(100)
    cache.put(CacheKind.VIEW, "view", 0, 25)
    for number in range(20):
        cache.put(CacheKind.SHAPE, number, number, 25)
    assert [key for key, _ in cache.newest(CacheKind.SHAPE)] == [19, 18, 17]
    assert cache.get(CacheKind.VIEW, "view") == 0


def test_the_oldest_views_are_evicted_before_details_and_a_second_put_replaces():
    cache = ByteCache(100)
    cache.put(CacheKind.DETAIL, "detail", 0, 40)
    for key in "abc":
        cache.put(CacheKind.VIEW, key, key, 20)
    assert cache.get(CacheKind.VIEW, "a") == "a"
    cache.put(CacheKind.SHAPE, "shape", 1, 20)
    assert [key for key, _ in cache.newest(CacheKind.VIEW)] == ["a", "c"]
    assert cache.get(CacheKind.DETAIL, "detail") == 0
    cache = ByteCache(100)
    cache.put(CacheKind.VIEW, "a", 1, 60)
    cache.put(CacheKind.VIEW, "a", 2, 50)
    assert (cache.get(CacheKind.VIEW, "a"), cache.used) == (2, 50)
    cache.clear(CacheKind.VIEW)
    assert (cache.get(CacheKind.VIEW, "a"), cache.used) == (None, 0)
