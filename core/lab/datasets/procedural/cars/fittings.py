"""Fittings of a car's body: mirrors, door handles, bumper bars, roof rails, a spoiler, exhausts."""

import math

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import CarDimensions
from core.lab.datasets.procedural.solids import Part, Solid, bar, line, moved, rounded_path, sweep, tube, turned


def fittings(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build the right half of all fittings, before the body is bowed."""
    parts = []
    if g.random() < 0.92:
        parts += _mirror(g, dims)
    if g.random() < 0.8:
        parts += _handles(dims)
    if g.random() < {"SUV": 0.6, "estate": 0.7, "hatchback": 0.15}.get(dims.kind, 0.0):
        parts += _roof_rail(dims)
    if g.random() < {"hatchback": 0.5, "SUV": 0.5, "estate": 0.35}.get(dims.kind, 0.0):
        parts += _roof_spoiler(g, dims)
    if g.random() < {"coupe": 0.35, "sedan": 0.12}.get(dims.kind, 0.0):
        parts += _wing(g, dims)
    if g.random() < 0.18:
        parts += _bumper_bars(g, dims)
    return parts + (_exhaust(dims) if g.random() < 0.5 else [])


def _mirror(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build a mirror at the foot of the windscreen's pillar."""
    y = dims.cowl[0] - 0.35 * (dims.cowl[0] - dims.head) - g.uniform(0.0, 0.1)
    belt, x = float(dims.beltline(y)), float(dims.half(y))
    tall = g.uniform(0.1, 0.15) * (1.5 if dims.kind == "van" else 1.0)
    wide = g.uniform(0.16, 0.22)
    head = _pod(wide, 0.1, tall)
    arm = line((x - 0.12, y, belt + 0.01), (x + 0.06, y + 0.01, belt + 0.06), 3)
    place = (x + wide / 2, y, belt + 0.03 + tall / 2)
    return [Part("mirror", moved(head, place)), Part("trim", bar(arm, 0.05, 0.03, side=(0, 1, 0)))]


def _handles(dims: CarDimensions) -> list[Part]:
    """Build a handle before the rear edge of each door."""
    first = dims.pillars[0] if dims.pillars else dims.cowl[0] - 1.2
    ends = [first] if dims.doors == 2 else [first, first - 0.8]
    parts = []
    for end in ends:
        y = np.array([end + 0.08, end + 0.14, end + 0.2])
        z = dims.beltline(y) - 0.07
        path = np.stack((0.99 * dims.half(y), y, z), -1)
        parts.append(Part("handle", bar(path, 0.03, 0.035, side=(1, 0, 0))))
    return parts


def _roof_rail(dims: CarDimensions) -> list[Part]:
    y = np.linspace(dims.head - 0.15, dims.roof_end + 0.12, 9)
    x = dims.rail(y) - 0.07
    lift = np.array([-0.02, 0.045, 0.055, 0.055, 0.055, 0.055, 0.055, 0.045, -0.02])
    path = np.stack((x, y, dims.edge(y) + 0.3 * dims.crown + lift), -1)
    return [Part("rail", bar(path, 0.03, 0.03))]


def _roof_spoiler(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build a lip that extends the roof over the rear window."""
    long, y = g.uniform(0.16, 0.28), dims.roof_end
    wide = 2 * float(dims.rail(y)) - 0.12
    board = turned(_board(wide, long, 0.035), 0, g.uniform(-0.02, 0.12))
    return [Part("spoiler", moved(board, (0, y - 0.2 * long, float(dims.top(y)) - 0.012)))]


def _wing(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build a wing on posts at the boot lid's end."""
    y, high = -dims.end + 0.14, g.uniform(0.05, 0.22)
    z = float(dims.top(y))
    wide = 1.7 * float(dims.half(y))
    board = turned(_board(wide, g.uniform(0.16, 0.26), 0.03), 0, g.uniform(-0.12, 0.0))
    post = line((0.36 * wide, y, z - 0.06), (0.36 * wide, y, z + high), 2)
    return [Part("spoiler", moved(board, (0, y, z + high))), Part("spoiler", bar(post, 0.03, 0.12))]


def _bumper_bars(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build bars around front and rear, as on older and off-road cars."""
    z = dims.clearance + g.uniform(0.4, 0.6) * (dims.nose - dims.clearance)
    tall = g.uniform(0.07, 0.14)
    parts = []
    for sign in (-1, 1):
        x = float(dims.half(sign * dims.end))
        out = sign * (dims.end + 0.06)
        corners = [(0.0, out, z), (x + 0.02, out, z), (x + 0.06, sign * (dims.end - 0.3), z)]
        parts.append(Part("bumper bar", bar(rounded_path(corners, cut=0.12), 0.06, tall, side=(0, sign, 0.0))))
    return parts


def _exhaust(dims: CarDimensions) -> list[Part]:
    z = float(dims.floor(-dims.end))
    path = line((0.5, -dims.end - 0.03, z), (0.5, -dims.end + 0.3, z - 0.02), 2)
    return [Part("exhaust", tube(path, 0.035, 10))]


def _pod(wide: float, deep: float, tall: float) -> Solid:
    """Build a mirror's housing around the origin, rounder on the outer side (+x)."""
    angle = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    swell = (np.abs(np.cos(angle)) ** 4 + np.abs(np.sin(angle)) ** 4) ** -0.25
    section = np.stack((np.cos(angle), np.sin(angle)), -1) * swell[:, None]
    share = np.array([0.75, 0.95, 1.0, 0.95, 0.6])
    across = wide * np.array([-0.5, -0.3, 0.1, 0.35, 0.5])
    path = np.stack((across, 0 * across, 0 * across), -1)
    return sweep(path, section, 0.5 * share[:, None] * (deep, tall), side=(0, 1, 0))


def _board(wide: float, deep: float, thick: float) -> Solid:
    """Build a flat board across the car, around the origin; it bends with the body."""
    return bar(line((-wide / 2, 0, 0), (wide / 2, 0, 0), 9), deep, thick, side=(0, 1, 0))
