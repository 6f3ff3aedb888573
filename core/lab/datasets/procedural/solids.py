"""Solids for furniture and cars: slabs, bars, tubes and shells, built by joining loops or sheets of points.

Every solid stores its points before bending and placing (``local``), so that patterns bend with the solid.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import ParamSpec

import numpy as np
from jaxtyping import Float, Int, UInt8

from core.lab.datasets.rasteriser import Surface

Given = ParamSpec("Given")
Points = Float[np.ndarray, "points 3"]
Point = Float[np.ndarray, "3"]
_CREASE = math.cos(math.radians(42))  # faces that meet at a sharper angle keep an edge between them


@dataclass(frozen=True)
class Solid:
    """A closed triangle mesh, faces counter-clockwise from outside."""

    vertices: Points  # m
    faces: Int[np.ndarray, "faces 3"]
    local: Points  # m, before bending and placing; grain runs along z


@dataclass(frozen=True)
class Part:
    """A solid and the label by which a texture paints it."""

    label: str
    solid: Solid
    of: str = ""  # name of the object's part, such as seat; empty: its label if that is a part, else the first


@dataclass(frozen=True)
class Shape:
    """A whole object: bounding box centred on the origin with a diagonal of 1, z up, its front at +y."""

    kind: str
    parts: tuple[Part, ...]
    metre: float  # scene units


def belongs_to(name: str) -> Callable[[Callable[Given, list[Part]]], Callable[Given, list[Part]]]:
    """Decorate a function that builds one of an object's named parts."""

    def decorated(build: Callable[Given, list[Part]]) -> Callable[Given, list[Part]]:
        @wraps(build)
        def built(*given: Given.args, **named: Given.kwargs) -> list[Part]:
            return [replace(part, of=name) for part in build(*given, **named)]

        return built

    return decorated


def normalised_shape(kind: str, parts: Sequence[Part]) -> Shape:
    """Bring parts in metres to ShapeNet's place and scale."""
    used = np.concatenate([part.solid.vertices for part in parts])
    low, high = used.min(0), used.max(0)
    metre = 1.0 / float(np.linalg.norm(high - low))
    middle = (low + high) / 2
    placed = [replace(p, solid=replace(p.solid, vertices=(p.solid.vertices - middle) * metre)) for p in parts]
    return Shape(kind, tuple(placed), metre)


def slab(
    width: float,
    depth: float,
    thickness: float,
    corner: float,
    edge: float,
    taper: float = 0.0,
    dome: float = 0.0,
) -> Solid:
    """Build a board or cushion lying in xy, its middle on the origin.

    Args:
        width, depth, thickness: m, along x, y and z.
        corner: m, radius of the outline's corners.
        edge: m, radius of the rounding from top to side.
        taper: fraction by which the back (-y) is narrower than the front.
        dome: m, bulge of the top's middle (a dip if negative).
    """
    edge = min(edge, 0.499 * thickness, 0.4 * min(width, depth))
    quarter = np.linspace(0, math.pi / 2, 4 if edge > 0.006 else 2)
    rows = [(edge * (1 - math.sin(a)), -thickness / 2 + edge * (1 - math.cos(a))) for a in quarter]
    rows += [(inset, -z) for inset, z in reversed(rows)]
    loops = [_outline(width, depth, corner, inset, taper, z) for inset, z in rows]
    inner = (0.8, 0.55, 0.3, 0.1)
    below = [loops[0] * (s, s, 1) for s in reversed(inner)]
    above = [loops[-1] * (s, s, 1) + (0, 0, dome * (1 - s**2)) for s in inner]
    return loft(np.stack(below + loops + above))


def tube(path: Points, radius: float | Sequence[float], sides: int = 14) -> Solid:
    """Build a round bar along a path; a radius per point gives turned legs, trumpet feet or cones."""
    angle = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    circle = np.stack((np.cos(angle), np.sin(angle)), -1)
    scale = np.broadcast_to(np.asarray(radius, float), len(path))
    return sweep(path, circle, np.stack((scale, scale), -1))


def bar(path: Points, width: float, depth: float, end: float = 1.0, side: Sequence[float] = (1.0, 0.0, 0.0)) -> Solid:
    """Build a rectangular bar along a path.

    Args:
        path: m; the middle line.
        width, depth: m; ``width`` is measured along ``side``.
        end: the section's scale at the path's end, 1 at its start.
        side: a world direction, not parallel to the path.
    """
    corner = 0.18 * min(width, depth)
    section = _outline(width, depth, corner, 0.0, 0.0, 0.0, steps=3, between=0)[:, :2]
    scale = np.linspace(1.0, end, len(path))
    return sweep(path, section, np.stack((scale, scale), -1), side)


def sweep(
    path: Points,
    section: Float[np.ndarray, "corners 2"],
    scales: Float[np.ndarray, "points 2"],
    side: Sequence[float] | None = None,
) -> Solid:
    """Sweep a closed section along a path without twisting it."""
    tangents = _unit(np.gradient(path, axis=0))
    start = np.eye(3)[np.argmin(np.abs(tangents[0]))] if side is None else np.asarray(side, float)
    across = np.empty_like(path)
    for i, tangent in enumerate(tangents):
        start = start - tangent * (start @ tangent)
        start = across[i] = start / max(float(np.linalg.norm(start)), 1e-9)
    other = np.cross(tangents, across)
    flat = section[None] * scales[:, None]
    loops = path[:, None] + flat[..., :1] * across[:, None] + flat[..., 1:] * other[:, None]
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    straight = np.concatenate((flat, np.broadcast_to(way[:, None, None], (*flat.shape[:2], 1))), -1)
    return loft(loops, straight)


def loft(loops: Float[np.ndarray, "loops points 3"], local: np.ndarray | None = None) -> Solid:
    """Join closed loops, each counter-clockwise seen from the next, and close both ends."""
    rows, count = loops.shape[:2]
    grid = np.arange(rows * count).reshape(rows, count)
    faces = [quads(np.concatenate((grid, grid[:, :1]), 1))]
    for row, centre, flip in ((0, rows * count, True), (-1, rows * count + 1, False)):
        ring = np.stack((grid[row], np.roll(grid[row], -1), np.full(count, centre)), -1)
        faces.append(ring[:, ::-1] if flip else ring)
    local = loops if local is None else local
    return Solid(_with_centres(loops), np.concatenate(faces), _with_centres(local))


def shell(sheet: Float[np.ndarray, "rows columns 3"], thickness: float) -> Solid:
    """Thicken a sheet of points: a bent back, a bucket seat. Rows x columns is the outer side."""
    rows, columns = sheet.shape[:2]
    along, across = np.gradient(sheet, axis=0), np.gradient(sheet, axis=1)
    normal = _unit(np.cross(across, along))
    u = np.cumsum(np.linalg.norm(across, axis=-1), 1)
    u -= u.mean(1, keepdims=True)
    v = np.cumsum(np.linalg.norm(along, axis=-1), 0)
    # A half-circle rim gives a thick sheet (an upholstered tub) soft edges.
    layers, locals_ = [], []
    for a in np.linspace(math.pi / 2, -math.pi / 2, 5):
        lift = 0.5 * thickness * math.sin(a)
        layers.append(sheet + lift * normal)
        locals_.append(np.stack((u, np.full_like(u, lift), v), -1))
    swell = [0.5 * thickness * math.cos(a) for a in np.linspace(math.pi / 2, -math.pi / 2, 5)]
    size = rows * columns
    grid = np.arange(size).reshape(rows, columns)
    rim = np.concatenate((grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]))
    outward = _unit(_rim_outward(sheet)).reshape(-1, 3)
    vertices = [layers[0].reshape(-1, 3), layers[-1].reshape(-1, 3)]
    local = [locals_[0].reshape(-1, 3), locals_[-1].reshape(-1, 3)]
    for k in (1, 2, 3):
        vertices.append((layers[k].reshape(-1, 3) + swell[k] * outward)[rim])
        local.append(locals_[k].reshape(-1, 3)[rim])
    rings = [rim] + [2 * size + k * len(rim) + np.arange(len(rim)) for k in range(3)] + [rim + size]
    closed = np.stack([np.append(ring, ring[0]) for ring in rings])
    faces = [quads(grid), quads(grid + size)[:, ::-1], quads(closed)[:, ::-1]]
    return Solid(np.concatenate(vertices), np.concatenate(faces), np.concatenate(local))


def rounded_path(
    corners: Sequence[Sequence[float]] | Float[np.ndarray, "corners axes"], rounds: int = 3, cut: float = 0.25
) -> Float[np.ndarray, "points axes"]:
    """Round the corners of a path by Chaikin's subdivision; its ends stay."""
    path = np.asarray(corners, float)
    for _ in range(rounds):
        first, second = path[:-1] * (1 - cut) + path[1:] * cut, path[:-1] * cut + path[1:] * (1 - cut)
        middle = np.stack((first, second), 1).reshape(-1, path.shape[1])
        path = np.concatenate((path[:1], middle[1:-1], path[-1:]))
        cut = 0.25
    return path


def line(start: Sequence[float] | np.ndarray, end: Sequence[float] | np.ndarray, count: int = 2) -> Points:
    """Return evenly spaced points from start to end."""
    return np.linspace(np.asarray(start, float), np.asarray(end, float), count)


def moved(solid: Solid, offset: Sequence[float]) -> Solid:
    """Shift a solid by m along x, y, z."""
    return replace(solid, vertices=solid.vertices + np.asarray(offset, float))


def turned(solid: Solid, axis: int, angle: float) -> Solid:
    """Rotate a solid about a world axis through the origin, rad."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i], matrix[j, j], matrix[i, j], matrix[j, i] = c, c, -s, s
    return replace(solid, vertices=solid.vertices @ matrix.T)


def warped(solid: Solid, bend: Callable[[Points], Points], mirrors: bool = False) -> Solid:
    """Move a solid's points by a function; ``mirrors`` if that function swaps left and right."""
    faces = solid.faces[:, ::-1] if mirrors else solid.faces
    return Solid(bend(solid.vertices), faces, solid.local)


def surface(solids: Sequence[Solid], texture: UInt8[np.ndarray, "h w 4"], period: float) -> Surface:
    """Merge solids into a surface: smooth normals, creases at edges, a square tile every ``period`` m."""
    vertices = np.concatenate([solid.vertices[solid.faces] for solid in solids]).reshape(-1, 3)
    normals = np.concatenate([_creased_normals(solid) for solid in solids]).reshape(-1, 3)
    uvs = np.concatenate([_painted_at(solid) for solid in solids]).reshape(-1, 2) / period
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Surface(vertices, normals, faces, np.ones_like(vertices), uvs, texture)


def same_place(points: Points) -> Int[np.ndarray, "points"]:
    """Number points so that points less than a micrometre (in scene units) apart share a number."""
    # One hash of the rounded coordinates sorts many times faster than rows.
    steps = np.rint(points * 1e6).astype(np.int64)
    with np.errstate(over="ignore"):
        key = steps @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64).view(np.int64)
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def _painted_at(solid: Solid) -> Float[np.ndarray, "faces 3 2"]:
    """Return the pattern coordinates of face corners, m: the two axes a face is most parallel to; grain (z) upright."""
    corners = solid.local[solid.faces]
    facing = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).argmax(-1)
    axes = np.array([[1, 2], [0, 2], [0, 1]])[facing]
    return np.take_along_axis(corners, np.repeat(axes[:, None], 3, 1), -1)


def _creased_normals(solid: Solid) -> Float[np.ndarray, "faces 3 3"]:
    """Return for each face corner the mean normal of the faces around that meet it at a shallow angle."""
    corners = solid.vertices[solid.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = _unit(area)
    point = same_place(corners.reshape(-1, 3))
    order = np.argsort(point, kind="stable")
    counts = np.bincount(point)
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    around = counts[point]
    # All pairs (corner, corner at the same point), flattened.
    left = np.repeat(np.arange(len(point)), around)
    step = np.arange(len(left)) - np.repeat(np.cumsum(around) - around, around)
    right = order[np.repeat(starts[point], around) + step]
    shallow = (facing[left // 3] * facing[right // 3]).sum(-1) > _CREASE
    total = np.zeros((len(point), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(left[shallow], area[right[shallow] // 3, axis], len(point))
    own = np.repeat(facing, 3, 0)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.where(length > 1e-15, total / np.maximum(length, 1e-15), own).reshape(-1, 3, 3)


def _outline(
    width: float,
    depth: float,
    corner: float,
    inset: float,
    taper: float,
    z: float,
    steps: int = 6,
    between: int = 5,
) -> Points:
    """Return a rectangle with round corners, counter-clockwise seen from above.

    Has ``steps`` points a corner, and ``between`` on each straight side so that boards can bend.
    """
    half = np.array([width, depth]) / 2 - inset
    radius = min(max(corner - inset, 0.15 * corner, 1e-4), 0.999 * float(half.min()))
    angle = np.linspace(0, math.pi / 2, steps)
    arc = radius * (np.stack((np.cos(angle), np.sin(angle)), -1) - 1) + half
    quarters = [arc, arc[::-1] * (-1, 1), -arc, arc[::-1] * (1, -1)]
    pieces = []
    for quarter, following in zip(quarters, quarters[1:] + quarters[:1], strict=True):
        pieces += [quarter, np.linspace(quarter[-1], following[0], between + 2)[1:-1]]
    points = np.concatenate(pieces)
    points[:, 0] *= 1 + taper * (points[:, 1] / depth - 0.5)
    return np.concatenate((points, np.full((len(points), 1), z)), -1)


def _rim_outward(sheet: np.ndarray) -> np.ndarray:
    """Return directions off the sheet across its nearest border; zero inside."""
    out = np.zeros_like(sheet)
    out[0] += sheet[0] - sheet[1]
    out[-1] += sheet[-1] - sheet[-2]
    out[:, 0] += sheet[:, 0] - sheet[:, 1]
    out[:, -1] += sheet[:, -1] - sheet[:, -2]
    return out


def quads(grid: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, "faces 3"]:
    """Return two triangles for each cell of a grid of indices."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate((np.stack((a, b, c), -1).reshape(-1, 3), np.stack((a, c, d), -1).reshape(-1, 3)))


def _with_centres(loops: np.ndarray) -> Points:
    """Return all loops' points, then the middles of the first and the last loop."""
    return np.concatenate((loops.reshape(-1, 3), loops[:1].mean(1), loops[-1:].mean(1)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors to length 1; zero stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
