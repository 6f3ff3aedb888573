"""Cut open or closed meshes along curves, for crisp outlines of windows, lamps and wheel arches.

A region is a list of functions of the points; a point is inside if all of them are positive.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from core.lab.datasets.procedural.solids import Points, Solid, same_place

Values = Float[np.ndarray, "points"]
Region = Sequence[Callable[[Points], Values]]


def carve(solid: Solid, region: Region) -> tuple[Solid, Solid]:
    """Split a mesh into the part inside a region and the rest; functions are interpolated linearly along edges."""
    # Faces outside one function stay whole, or its line would continue around the object.
    near = np.ones(len(solid.faces), bool)
    for inside in region:
        a, b, c = (inside(solid.vertices) > 0)[solid.faces.T]
        near &= a | b | c
    rest = [_compact(replace(solid, faces=solid.faces[~near]))]
    solid = _compact(replace(solid, faces=solid.faces[near]))
    for inside in region:
        solid, outside = _halves(solid, inside(solid.vertices))
        rest.append(outside)
    return solid, joined(rest)


def inset(piece: Solid, move: Callable[[Points], Points]) -> Solid:
    """Move a piece cut from a half mesh (x >= 0); connect its borders by walls."""
    rim = _border(piece)
    rim = rim[(np.abs(piece.vertices[rim, 0]) > 1e-6).any(1)]
    count = len(piece.vertices)
    start, end = rim.T
    walls = np.concatenate((np.stack((start, end, end + count), -1), np.stack((start, end + count, start + count), -1)))
    vertices = np.concatenate((piece.vertices, move(piece.vertices)))
    return Solid(vertices, np.concatenate((piece.faces + count, walls)), np.concatenate((piece.local, piece.local)))


def mirrored(solid: Solid) -> Solid:
    """Return the mesh with its mirror image at x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    return joined([solid, Solid(solid.vertices * flip, solid.faces[:, ::-1], solid.local * flip)])


def joined(solids: Sequence[Solid]) -> Solid:
    """Join several meshes."""
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.faces + start for solid, start in zip(solids, starts[:-1], strict=True)]),
        np.concatenate([solid.local for solid in solids]),
    )


def _halves(solid: Solid, value: Values) -> tuple[Solid, Solid]:
    """Split a mesh by the sign of ``value`` at its vertices."""
    inside = value > 0
    if inside.all():
        return solid, _compact(replace(solid, faces=solid.faces[:0]))
    corners = inside[solid.faces]
    count = corners[:, 0].astype(int) + corners[:, 1] + corners[:, 2]
    mixed = (count == 1) | (count == 2)
    # The corner that is alone on its side comes first.
    alone = np.where(count == 1, corners.argmax(1), corners.argmin(1))[mixed]
    order = (alone[:, None] + np.arange(3)) % 3
    cut = np.take_along_axis(solid.faces[mixed], order, 1)
    size, lone_inside = len(solid.vertices), inside[cut[:, 0]]
    crossing = np.arange(2 * len(cut)).reshape(2, -1) + size
    a, b, c = cut.T
    positive = np.where(lone_inside, np.stack((a, a)), np.stack((b, c))).reshape(-1)
    negative = np.where(lone_inside, np.stack((b, c)), np.stack((a, a))).reshape(-1)
    # Interpolated from the positive end, so that both faces at an edge get exactly the same point.
    way = (value[positive] / (value[positive] - value[negative]))[:, None]
    grown = [
        np.concatenate((points, points[positive] + way * (points[negative] - points[positive])))
        for points in (solid.vertices, solid.local)
    ]
    p, q = crossing
    tip = np.stack((a, p, q), -1)
    base = np.stack((np.stack((p, b, c), -1), np.stack((p, c, q), -1)))
    own = np.concatenate((solid.faces[count == 3], tip[lone_inside], *base[:, ~lone_inside]))
    other = np.concatenate((solid.faces[count == 0], tip[~lone_inside], *base[:, lone_inside]))
    whole = Solid(grown[0], own, grown[1])
    return _compact(whole), _compact(replace(whole, faces=other))


def _compact(solid: Solid) -> Solid:
    """Remove points that no face uses."""
    used = np.zeros(len(solid.vertices), bool)
    used[solid.faces] = True
    return Solid(solid.vertices[used], (np.cumsum(used) - 1)[solid.faces], solid.local[used])


def _border(solid: Solid) -> Int[np.ndarray, "edges 2"]:
    """Return edges that belong to one face only, in that face's direction; coincident points count as one."""
    point = same_place(solid.vertices)
    corners = point[solid.faces]
    # A cut close to a corner leaves faces without area, whose edges would count twice.
    faces = solid.faces[(corners != np.roll(corners, 1, 1)).all(1)]
    edges = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    ends = point[edges]
    key = ends.min(1) * len(solid.vertices) + ends.max(1)
    _, index, times = np.unique(key, return_index=True, return_counts=True)
    return edges[index[times == 1]]
