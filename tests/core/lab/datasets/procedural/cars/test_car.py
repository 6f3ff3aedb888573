"""Procedural cars: every seed gives one sane car."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_fill_holes

from core.lab.datasets.procedural.cars.car import car
from core.lab.datasets.procedural.cars.kinds import KINDS, sample_dimensions
from core.lab.datasets.procedural.cars.paint import LABELS, car_texture
from core.lab.datasets.procedural.table import ProceduralObject, surfaces
from core.lab.datasets.rasteriser import Rasteriser
from core.lab.datasets.srn_cameras import training_views
from tests.core.lab.datasets.procedural.shapes import faces, metres, points

SEEDS = range(40)


made = cache(car)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_every_seed_gives_a_sane_car(seed: int) -> None:
    shape = car(seed)
    wide, long, tall = metres(shape)
    assert 1.6 < wide < 2.7
    assert 3.1 < long < 6.1
    assert 1.2 < tall < 2.6
    assert {part.label for part in shape.parts} <= set(LABELS)
    assert 6_000 < faces(shape) < 25_000


@pytest.mark.parametrize("kind", KINDS)
def test_plans_hold_together(kind: str) -> None:
    for seed in range(100):
        dims = sample_dimensions(np.random.default_rng(seed), kind)
        y, z = dims.profile.T
        assert (np.diff(y) > 0).all()
        assert z.max() == pytest.approx(dims.height, abs=0.06)
        front, rear = dims.axles
        assert dims.wheel > 0.25
        assert front + dims.wheel < dims.end - 0.1
        assert rear - dims.wheel > -dims.end + 0.1
        # The cabin is longer than its windscreen, and the doors' windows have room.
        assert dims.head - dims.roof_end > 0.4
        assert dims.head - dims.side_glass > 0.4


def test_left_and_right_are_mirror_images() -> None:
    """Of points rounded to a millionth, hashed to one number each: the same ones on both sides."""
    places = np.array([1, 2 * 10**6, 4 * 10**12])
    for seed in SEEDS:
        for part in made(seed).parts:
            solid = part.solid
            steps = np.rint(solid.vertices * 1e6).astype(int) @ places
            image = np.rint(solid.vertices * (-1e6, 1e6, 1e6)).astype(int) @ places
            assert np.array_equal(np.sort(steps), np.sort(image)), (seed, part.label)


def test_all_kinds_come_up() -> None:
    assert {made(seed).kind for seed in SEEDS} == set(KINDS)


def test_wheels_stand_on_the_ground_and_nothing_else_does() -> None:
    for seed in SEEDS:
        shape = made(seed)
        tyres = points(shape, "tyre")
        ground = tyres[:, 2].min()
        others = points(shape, *(set(LABELS) - {"tyre"}))
        assert others[:, 2].min() > ground + 0.02 * shape.metre, seed
        feet = tyres[tyres[:, 2] < ground + 0.005]
        assert {(x > 0, y > 0) for x, y, _ in feet} == {(a, b) for a in (False, True) for b in (False, True)}


def test_the_front_is_at_plus_y() -> None:
    for seed in SEEDS:
        shape = made(seed)
        light, tail = points(shape, "light"), points(shape, "tail")
        assert light[:, 1].min() > 0.2
        assert tail[:, 1].max() < -0.2


def test_every_car_has_glass_on_all_sides_but_perhaps_a_vans_rear() -> None:
    for seed in SEEDS:
        shape = made(seed)
        glass = points(shape, "glass")
        across, along = np.abs(glass[:, 0]) / shape.metre, glass[:, 1]
        assert along.max() > 0.02
        assert across.max() > 0.6
        if shape.kind != "van":
            middle = along[across < 0.2]
            assert middle.min() < 0 < middle.max(), seed


def test_body_colours_are_those_of_a_car_park() -> None:
    """About half of the cars are white, silver, grey or black; some are vivid."""
    colours = np.array([car_texture(seed)["paint"].tile[0, 0, :3] for seed in range(300)]) / 255.0
    chroma = np.ptp(colours, axis=1)
    assert 0.35 < (chroma < 0.12).mean() < 0.7
    assert 0.05 < (chroma > 0.5).mean() < 0.4


def test_no_background_shines_through_the_body(rasteriser: Rasteriser) -> None:
    """From above, below and all around; rails, spoilers and bars enclose some ground rightly."""
    open_ones = {"rail", "spoiler", "bumper bar"}
    closed = [seed for seed in SEEDS if not open_ones & {part.label for part in made(seed).parts}]
    assert len(closed) > 8
    generator = np.random.default_rng(1)
    for seed in closed:
        rasteriser.upload(surfaces(ProceduralObject("cars", seed, seed)))
        for camera in training_views(6, generator, 1.3, 64):
            _, mask = rasteriser.render(camera)
            assert (binary_fill_holes(mask) & ~mask).sum() <= 3, (seed, camera)
