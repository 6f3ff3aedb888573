"""Wheels: a tyre, a rim or a hubcap, and the dark space between the spokes."""

import math
from collections.abc import Sequence

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import CarDimensions
from core.lab.datasets.procedural.solids import Part, Solid, bar, belongs_to, line, moved, quads

_SIDES = 20


@belongs_to("wheels")
def wheels(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build the right side's two wheels, placed at the bowed arches."""
    made = _wheel(g, dims.wheel, g.uniform(0.19, 0.25))
    parts = []
    for axle in dims.axles:
        x = float(dims.half(axle)) * 0.985
        y = float(dims.bent(np.array([[x, axle, dims.wheel]]))[0, 1])
        parts += [Part(part.label, moved(part.solid, (x, y, dims.wheel))) for part in made]
    return parts


def _wheel(g: np.random.Generator, radius: float, wide: float) -> list[Part]:
    """Build a wheel with its outer side at x = 0."""
    rim = radius * g.uniform(0.62, 0.74)
    soft = 0.12 * radius
    tread = [
        (-wide, 0.0),
        (-wide, radius - 2 * soft),
        (-wide + 0.5 * soft, radius - 0.25 * soft),
        (-wide + soft, radius),
        (-soft, radius),
        (-0.3 * soft, radius - 0.3 * soft),
        (0.0, radius - 1.2 * soft),
        (-0.01, rim),
        (-0.07, rim * 0.95),
    ]
    ring = [(-0.012, rim * 1.02), (-0.004, rim), (-0.012, rim * 0.9), (-0.06, rim * 0.86)]
    parts = [Part("tyre", _turned(tread))]
    if g.random() < 0.25:
        dome = [
            (-0.012, rim * 1.02),
            (-0.006, rim),
            (-0.03, rim * 0.8),
            (-0.02, rim * 0.55),
            (0.0, rim * 0.3),
            (0.0, 0.0),
        ]
        return [*parts, Part("wheel", _turned(dome))]
    parts += [Part("wheel", _turned(ring)), Part("under", _turned([(-0.055, rim * 0.96), (-0.055, 0.0)]))]
    return parts + _spokes(g, rim)


def _spokes(g: np.random.Generator, rim: float) -> list[Part]:
    """Build straight spokes, single or in pairs, and the hub."""
    count, double = int(g.integers(5, 9)), g.random() < 0.3
    wide = rim * (0.16 if double else g.uniform(0.22, 0.5)) * 6 / (count + 1)
    parts = [Part("wheel", _turned([(-0.05, rim * 0.3), (-0.02, rim * 0.26), (-0.014, 0.0)]))]
    for i in range(count):
        for twist in (-0.11, 0.11) if double else (0.0,):
            a = 2 * math.pi * (i + 0.25) / count + twist
            c, s = math.cos(a), math.sin(a)
            path = line((-0.032, 0.1 * rim * c, 0.1 * rim * s), (-0.026, 0.93 * rim * c, 0.93 * rim * s))
            parts.append(Part("wheel", bar(path, wide, 0.024, end=0.85, side=(0, -s, c))))
    return parts


def _turned(profile: Sequence[tuple[float, float]]) -> Solid:
    """Revolve a profile of (x, radius) about the x axis."""
    x, radius = np.array(profile).T
    angle = np.linspace(0, 2 * math.pi, _SIDES + 1)
    circle = np.stack((0 * angle, np.cos(angle), np.sin(angle)), -1)
    points = radius[:, None, None] * circle
    points[..., 0] = x[:, None]
    grid = np.arange(points.size // 3).reshape(points.shape[:2])
    return Solid(points.reshape(-1, 3), quads(grid), points.reshape(-1, 3))
