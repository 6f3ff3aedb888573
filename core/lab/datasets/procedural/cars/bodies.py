"""A car's body: one skin lofted from the side profile, then cut into paint, glass, lamps and other markings."""

from functools import partial

import numpy as np
from jaxtyping import Float

from core.lab.datasets.procedural.cars.dimensions import CarDimensions
from core.lab.datasets.procedural.cars.markings import markings
from core.lab.datasets.procedural.cars.skin import Skin, between, disc, over, under
from core.lab.datasets.procedural.cars.windows import windows
from core.lab.datasets.procedural.carving import inset
from core.lab.datasets.procedural.solids import Part, Points, Solid, quads, rounded_path

_STEP = 0.135  # m along the profile between sections


def body(g: np.random.Generator, dims: CarDimensions) -> list[Part]:
    """Build the right half of the body, before it is bowed."""
    skin = Skin(_sheet(dims))
    skin.label("under", [under(dims.floor, -0.035)])
    _wheel_arches(g, dims, skin)
    if dims.bed is not None:
        _bed(dims, skin, dims.bed)
    windows(g, dims, skin)
    markings(g, dims, skin)
    return skin.parts()


def _sheet(dims: CarDimensions) -> Solid:
    """Loft sections from rear to front, each from the floor over the side to the roof, and close both ends."""
    near = np.array([0.0, 0.012, 0.04, 0.09])
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(dims.profile, axis=0), axis=1))))
    even = np.interp(np.linspace(0, way[-1], round(way[-1] / _STEP)), way, dims.profile[:, 0])
    inner = even[np.abs(even) < dims.end - 0.1]
    y = np.concatenate((near - dims.end, inner, dims.end - near[::-1]))
    sections = _sections(dims, y)
    grid = np.concatenate((_cap(sections[0])[::-1], sections, _cap(sections[-1])))
    points = grid.reshape(-1, 3)
    return Solid(points, quads(np.arange(len(points)).reshape(grid.shape[:2]))[:, ::-1], points)


def _cap(section: Float[np.ndarray, "corners 3"]) -> Float[np.ndarray, "4 corners 3"]:
    """Shrink a section to its middle: the face of the front or the rear."""
    middle = np.array([0.0, section[0, 1], section[[0, -1], 2].mean()])
    return middle + (section - middle) * np.array([0.8, 0.5, 0.2, 0.0])[:, None, None]


def _sections(dims: CarDimensions, y: Float[np.ndarray, "sections"]) -> Float[np.ndarray, "sections corners 3"]:
    """Return half outlines across the car (right side) with rounded corners."""
    low, half, shoulder, edge, top = (f(y) for f in (dims.floor, dims.half, dims.shoulder, dims.edge, dims.top))
    rail, side = dims.rail(y), 0.985 * half
    step = dims.ledge * np.clip((edge - shoulder) / 0.12, 0, 1)
    high = shoulder - low
    corners = [
        (0 * y, low),
        (0.86 * half, low),
        (0.945 * half, low + 0.06 * high),
        (0.975 * half, low + 0.3 * high),
        (half, low + 0.68 * high),
        (side, shoulder),
        (side - step, shoulder + 0.3 * np.minimum(step, edge - shoulder)),
        (rail, edge),
        (0.5 * rail, top - 0.25 * dims.crown),
        (0 * y, top),
    ]
    path = rounded_path(np.array(corners).reshape(len(corners), -1), rounds=2, cut=dims.cut)
    x, z = path.reshape(len(path), 2, -1).transpose(1, 2, 0)
    return np.stack((x, np.broadcast_to(y[:, None], x.shape), z), -1)


def _wheel_arches(g: np.random.Generator, dims: CarDimensions, skin: Skin) -> None:
    """Cut recesses for the wheels, with a lip around them."""
    gap, lip, deep = g.uniform(0.03, 0.07), g.uniform(0.02, 0.06), 0.3
    for axle in dims.axles:
        inner = float(dims.half(axle)) - deep
        wheel = (axle, dims.wheel)
        beside = between(0, inner, dims.width)
        hole = skin.cut_out([*beside, disc((1, 2), wheel, dims.wheel + gap)], ("paint", "under"))
        skin.add("under", inset(hole, partial(_flattened, axis=0, level=inner)))
        skin.label("arch", [*beside, disc((1, 2), wheel, dims.wheel + gap + lip)])


def _bed(dims: CarDimensions, skin: Skin, bed: tuple[float, float]) -> None:
    """Cut a pickup's open bed, with its floor above the wheel arches."""
    front, rear = bed
    floor = 2 * dims.wheel + 0.09
    wide = dims.width / 2 * (1 - dims.narrow) - 0.1
    hole = skin.cut_out([over(dims.edge, -0.03), *between(1, rear, front), *between(0, -1.0, wide)], ("paint",))
    skin.add("bed", inset(hole, partial(_flattened, axis=2, level=floor)))


def _flattened(points: Points, axis: int, level: float) -> Points:
    """Project points along an axis onto one plane."""
    moved = points.copy()
    moved[:, axis] = level
    return moved
