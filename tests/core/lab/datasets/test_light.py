"""Daylight is the light of before, to the formula; a texture's own light is always the same, and is seen."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from core.lab.datasets.light import DAYLIGHT, Light, daylight, sample_light
from core.lab.datasets.procedural.solids import slab, surface
from core.lab.datasets.rasteriser import Rasteriser, Surface
from core.lab.datasets.render_objects import RenderTask, render_objects
from core.lab.datasets.srn import read_dataset
from tests.core.lab.datasets.test_rasteriser import GREY, camera

BACK = np.array([0.2, -1.0, 0.2])
LIT = "cars-texture-0000005"
"""A texture with a light of its own."""


def cube() -> Surface:
    return surface([slab(0.3, 0.3, 0.3, 0.001, 0.001)], GREY, 1.0)


def expected(light: Light, normal: np.ndarray) -> float:
    """The sRGB level of a matt grey face, in double precision."""

    def unit(vector: tuple[float, float, float] | np.ndarray) -> np.ndarray:
        return np.asarray(vector) / np.linalg.norm(vector)

    power = light.sky[0] + (light.sky[1] - light.sky[0]) * (0.5 + 0.5 * normal[2])
    for towards, most in ((light.key, light.key_power), (light.fill, light.fill_power), (BACK, light.back_power)):
        power += most * max(float(normal @ unit(towards)), 0.0)
    linear = min(((128 / 255 + 0.055) / 1.055) ** 2.4 * power, 1.0)
    return 255 * (1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("light", [DAYLIGHT, dataclasses.replace(sample_light(LIT), gloss=0.0)])
def test_a_matt_face_has_the_colour_of_the_formula(rasteriser: Rasteriser, light: Light) -> None:
    rasteriser.upload([cube()])
    rasteriser.set_light(light)
    faces = [(a, 0.0) for a in (0, math.pi / 2, math.pi, -math.pi / 2)] + [(0.0, math.pi / 2), (0.0, -math.pi / 2)]
    for azimuth, elevation in faces:
        c = math.cos(elevation)
        normal = np.array([c * math.cos(azimuth), c * math.sin(azimuth), math.sin(elevation)])
        found = rasteriser.render(camera(azimuth, elevation))[0][32, 32, 0]
        assert float(found) == pytest.approx(expected(light, normal), abs=1.0)
    rasteriser.set_light(DAYLIGHT)


def test_daylight_is_what_a_rasteriser_begins_with_and_comes_back_to(rasteriser: Rasteriser) -> None:
    """A light set between two renders is seen in the second though no context is current, and nowhere else."""
    view = camera(0.5, 0.5)
    with Rasteriser(64) as fresh:
        fresh.upload([cube()])
        before = fresh.render(view)[0]
        rasteriser.upload([cube()])
        rasteriser.set_light(sample_light(LIT))
        other = rasteriser.render(view)[0]
        assert np.array_equal(fresh.render(view)[0], before)
    rasteriser.set_light(DAYLIGHT)
    assert np.array_equal(rasteriser.render(view)[0], before)
    assert np.abs(other.astype(int) - before).max() > 10


def test_gloss_makes_a_highlight_that_moves_with_the_camera(rasteriser: Rasteriser) -> None:
    rasteriser.upload([cube()])
    top = [camera(0.4, math.pi / 2), camera(0.4, 1.0)]
    matt = [rasteriser.render(view)[0][32, 32].astype(int) for view in top]
    rasteriser.set_light(dataclasses.replace(DAYLIGHT, gloss=0.3))
    shiny = [rasteriser.render(view)[0][32, 32].astype(int) for view in top]
    rasteriser.set_light(DAYLIGHT)
    assert all((one >= other).all() for one, other in zip(shiny, matt, strict=True))
    assert max((one - other).max() for one, other in zip(shiny, matt, strict=True)) > 10


def test_half_of_the_textures_keep_daylight_and_each_light_is_always_the_same() -> None:
    names = [f"chairs-texture-{i:07d}" for i in range(1000)]
    lights = [sample_light(name) for name in names]
    assert 450 < sum(light is DAYLIGHT for light in lights) < 550
    assert lights == [sample_light(name) for name in names]
    others = [light for light in lights if light is not DAYLIGHT]
    assert len(set(others)) == len(others)
    for light in others:
        assert np.linalg.norm(light.key) == pytest.approx(1)
        assert light.key[2] > 0.25
        assert 0 < light.sky[0] < light.sky[1]
    assert 0.3 < sum(light.gloss > 0 for light in others) / len(others) < 0.5


def test_lights_are_those_of_the_datasets_that_are_rendered_already() -> None:
    """Another light for a texture would make a dataset that is resumed inconsistent."""
    light = sample_light("cars-texture-0000004")
    assert light.key == pytest.approx((-0.16537172961699023, 0.7532249861135759, 0.636635147739809), abs=1e-12)
    assert light.fill == pytest.approx((-0.4077851206668854, -0.9069023660805392, -0.10601600709427587), abs=1e-12)
    powers = (light.key_power, light.fill_power, light.back_power)
    assert powers == pytest.approx((0.4449251387443195, 0.055345190822478775, 0.08405042823435074), abs=1e-12)
    assert light.sky == pytest.approx((0.24968878721020396, 0.41533126302408596), abs=1e-12)
    assert sample_light("cars-texture-0000000") is DAYLIGHT


@pytest.mark.usefixtures("rasteriser")
def test_objects_are_in_daylight_or_in_the_light_of_their_texture(tmp_path: Path) -> None:
    """Two objects that differ in the name of their texture alone."""
    tasks = [RenderTask(name, "cube", name, lambda: [cube()]) for name in ("cars-texture-0000000", LIT)]
    for name, light in (("daylight", daylight), ("varied", sample_light)):
        list(render_objects(tasks, tmp_path / name, "cars", "test", 12, 32, light))
    day, lit = read_dataset(tmp_path / "daylight").objects
    assert np.array_equal(day.images, lit.images)
    day, lit = read_dataset(tmp_path / "varied").objects
    means = [float(views.images[views.masks].mean()) for views in (day, lit)]
    assert abs(means[0] - means[1]) > 2
