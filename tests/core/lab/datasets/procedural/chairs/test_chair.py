"""Procedural chairs: every seed gives one sane chair."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core.lab.datasets.procedural.chairs.chair import LABELS, chair
from tests.core.lab.datasets.procedural.shapes import faces, metres, points

SEEDS = range(120)
made = cache(chair)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_every_seed_gives_a_sane_chair(seed: int) -> None:
    shape = chair(seed)
    wide, deep, tall = metres(shape)
    assert 0.3 < wide < 1.15
    assert 0.28 < deep < 1.3
    assert 0.38 < tall < 1.35
    assert {part.label for part in shape.parts} <= set(LABELS)
    assert 200 < faces(shape) < 40_000


def test_chairs_are_symmetric_unless_their_star_is_not() -> None:
    for seed in SEEDS:
        shape = made(seed)
        cloud = points(shape)
        if shape.kind != "swivel":
            assert abs(cloud[:, 0].min() + cloud[:, 0].max()) < 1e-9
            assert abs(cloud[:, 0].mean()) < 0.01, seed


def test_a_sitter_looks_to_plus_y() -> None:
    """The highest parts stand behind the middle."""
    for seed in SEEDS:
        shape = made(seed)
        if shape.kind in ("stool", "bar chair"):
            continue
        cloud = points(shape)
        top = cloud[cloud[:, 2] > cloud[:, 2].max() - 0.05]
        assert top[:, 1].mean() < 0, (seed, shape.kind)


def test_all_kinds_come_up() -> None:
    kinds = {made(seed).kind for seed in SEEDS}
    assert len(kinds) == 10


def test_every_chair_stands_on_the_floor() -> None:
    """What touches the ground lies around the middle on all sides, or the chair would fall over."""
    for seed in SEEDS:
        cloud = points(made(seed))
        feet = cloud[cloud[:, 2] < cloud[:, 2].min() + 0.04]
        assert feet[:, 0].min() < -0.08
        assert feet[:, 0].max() > 0.08
        assert np.ptp(feet[:, 1]) > 0.15
