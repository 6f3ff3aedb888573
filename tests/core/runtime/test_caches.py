"""The cache stays below its limit and evicts the values that are cheapest to recompute first."""

from hypothesis import given
from hypothesis import strategies as st

from core.runtime.caches import ByteCache, CacheKind

puts = st.lists(st.tuples(st.sampled_from(list(CacheKind)), st.integers(0, 9), st.integers(0, 130)), max_size=40)


@given(puts)
def test_the_limit_holds(puts: list[tuple[CacheKind, int, int]]):
    cache = ByteCache(100)
    for kind, key, size in puts:
        most = {CacheKind.VIEW: 100, CacheKind.SHAPE: 75, CacheKind.DETAIL: 200 / 3}[kind]
        room = most - sum(held for later in CacheKind if later > kind for _, held in cache.newest(later))
        cache.put(kind, key, size, size)
        assert cache.used <= cache.limit
        assert cache.get(kind, key) == (size if size <= room else None)
    kept = [size for kind in CacheKind for _, size in cache.newest(kind)]
    assert sum(kept) == cache.used


@given(puts)
def test_make_room_evicts_until_the_value_fits(puts: list[tuple[CacheKind, int, int]]):
    cache = ByteCache(100)
    for kind, key, size in puts:
        cache.put(kind, key, size, size)
        before = cache.used
        if cache.make_room(CacheKind.VIEW, 40):
            assert cache.used <= 60
        else:
            assert cache.used == before
            assert sum(size for kind in CacheKind if kind > CacheKind.VIEW for _, size in cache.newest(kind)) > 60


def test_photo_detail_of_many_objects_leaves_a_third_to_shapes_and_views():
    cache = ByteCache(90)
    for number in range(20):
        cache.put(CacheKind.DETAIL, number, number, 10)
    assert [key for key, _ in cache.newest(CacheKind.DETAIL)] == [19, 18, 17, 16, 15, 14]
    cache.put(CacheKind.VIEW, "view", 0, 30)
    assert cache.get(CacheKind.VIEW, "view") == 0 and cache.used == cache.limit


def test_many_shapes_leave_a_quarter_to_views():
    cache = ByteCache(100)
    for number in range(20):
        cache.put(CacheKind.SHAPE, number, number, 25)
    cache.put(CacheKind.VIEW, "view", 0, 25)
    cache.put(CacheKind.SHAPE, 20, 20, 25)
    assert [key for key, _ in cache.newest(CacheKind.SHAPE)] == [20, 19, 18]
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
