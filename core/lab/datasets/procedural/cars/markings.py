"""Markings cut into or painted on a car's body: lamps, grille, number plates, door gaps, fields of colour."""

import numpy as np

from core.lab.datasets.procedural.cars.dimensions import CarDimensions
from core.lab.datasets.procedural.cars.skin import Inside, Skin, between, disc, over
from core.lab.datasets.procedural.carving import Region, Values
from core.lab.datasets.procedural.solids import Points

_SEAM = 0.009  # m, half the width of the gap around a door


def markings(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Apply all markings; earlier ones cover later ones."""
    _head_lamps(g, dims, skin)
    _tail_lamps(g, dims, skin)
    _grille(g, dims, skin)
    _plates(g, dims, skin)
    _seams(dims, skin)
    _bumpers(g, dims, skin)
    _stripes(g, dims, skin)


def _front(dims: CarDimensions, depth: float) -> Region:
    return between(1, dims.end - depth, np.inf)


def _rear(dims: CarDimensions, depth: float) -> Region:
    return between(1, -np.inf, depth - dims.end)


def _head_lamps(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label round lamps, or slanted bands that reach around the corner."""
    x = dims.width / 2 * (1 - dims.narrow)
    high, front = dims.nose * g.uniform(0.86, 0.93), _front(dims, g.uniform(0.12, 0.4))
    if g.random() < 0.25:
        radius = g.uniform(0.08, 0.105)
        centre = (x - g.uniform(1.4, 1.9) * radius, high - radius)
        skin.label("light", [*front, disc((0, 2), centre, radius)])
        return
    tall, slant, wide = g.uniform(0.09, 0.17), g.uniform(-0.05, 0.16), g.uniform(0.26, 0.5)

    def below(p: Points) -> Values:
        return high + slant * (p[:, 0] - x) - p[:, 2]

    skin.label("light", [*front, below, lambda p: tall - below(p), *between(0, x - wide, np.inf)])


def _tail_lamps(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label upright lamps at the corners, or horizontal ones, sometimes as one band."""
    x = dims.width / 2 * (1 - dims.narrow)
    upright = dims.kind not in ("sedan", "coupe") and g.random() < 0.6
    if upright:
        wide, tall = g.uniform(0.1, 0.2), g.uniform(0.25, 0.42)
    else:
        wide, tall = g.uniform(0.25, 0.5), g.uniform(0.1, 0.2)
    high = dims.tail + (0.04 if dims.kind == "pickup" else (0.3 if upright else 0.55) * tall)
    if not upright and g.random() < 0.12:
        wide = x
    rear = _rear(dims, g.uniform(0.08, 0.28))
    lamp = [*rear, *between(2, high - tall, high), *between(0, x - wide, np.inf)]
    skin.label("tail", lamp, of=("paint", "pillar"))


def _grille(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label the grille in its frame, and the intake below."""
    high = dims.nose * g.uniform(0.8, 0.88)
    tall, wide, taper = g.uniform(0.06, 0.22), g.uniform(0.2, 0.5), g.uniform(-0.5, 0.6)

    def opening(margin: float) -> Region:
        def sides(p: Points) -> Values:
            return wide - margin - p[:, 0] + taper * (p[:, 2] - high)

        return [*_front(dims, 0.12), *between(2, high - tall + margin, high - margin), sides]

    if g.random() < 0.85:
        skin.label("chrome", opening(0.0))
        skin.label("grille", opening(g.uniform(0.012, 0.022)), of=("chrome",))
    if g.random() < 0.8:
        low, reach = float(dims.floor(dims.end)) + g.uniform(0.04, 0.09), g.uniform(0.3, 0.65)
        height = between(2, low, low + g.uniform(0.05, 0.11))
        skin.label("grille", [*_front(dims, 0.12), *height, *between(0, -1.0, reach)])


def _plates(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    wide, tall = (0.26, 0.06) if g.random() < 0.6 else (0.16, 0.08)
    front = 0.5 * (dims.nose + dims.clearance) - g.uniform(0.0, 0.06)
    rear = dims.tail - g.uniform(0.1, 0.35)
    for end, z in ((_front(dims, 0.1), front), (_rear(dims, 0.1), rear)):
        plate = [*end, *between(2, z - tall, z + tall), *between(0, -1.0, wide)]
        skin.label("plate", plate, of=("paint", "grille", "chrome"))


def _seams(dims: CarDimensions, skin: Skin) -> None:
    """Label the gaps at the doors' front and rear edges."""
    first = dims.cowl[0] - 0.08
    behind = dims.pillars[0] if dims.pillars else first - 1.1
    seams = [first, behind]
    if dims.doors == 4 and dims.kind != "van":
        seams.append(max(behind - 0.85, dims.axles[1] + dims.wheel + 0.1))
    for y in seams:
        gap = between(1, y - _SEAM, y + _SEAM)
        skin.label("seam", [*gap, _side(dims, 0.8), *between(2, dims.clearance + 0.12, np.inf)])


def _bumpers(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label bumpers and sills, often painted like the rest."""
    sill = dims.clearance + g.uniform(0.12, 0.2) * dims.height
    bumper = dims.clearance + g.uniform(0.3, 0.55) * (dims.nose - dims.clearance)
    depth = g.uniform(0.3, 0.45)
    for end in (_front(dims, depth), _rear(dims, depth)):
        skin.label("bumper", [*end, *between(2, 0.0, bumper)])
    skin.label("sill", between(2, 0.0, sill))


def _stripes(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Label one or two stripes over the whole car and a band along its side; most textures hide them."""
    wide, apart = g.uniform(0.12, 0.25), g.choice((-1.0, 0.05))
    across = between(0, apart, max(apart, 0.0) + wide)
    stripe = [over(dims.edge), *between(1, 0.1 - dims.end, dims.end - 0.1), *across]
    skin.label("stripe", stripe)
    skin.label("roof stripe", stripe, of=("roof",))
    share, tall = g.uniform(0.45, 0.75), g.uniform(0.06, 0.14)
    line = dims.clearance + share * (dims.belt[0] - dims.clearance)
    height = between(2, line - tall / 2, line + tall / 2)
    skin.label("band", [*height, _side(dims, 0.9), *between(1, 0.25 - dims.end, dims.end - 0.25)])


def _side(dims: CarDimensions, share: float) -> Inside:
    """Return a region further out than a fraction of the body's half width."""
    return lambda p: p[:, 0] - share * dims.half(p[:, 1])
