"""Recombined chairs: the legs of one mesh under the seat of another.

A chair is cut just below its seat. The lower half of one, scaled to another's seat, carries the upper half. So n chairs
give up to n^2 new shapes of modelled parts.
"""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from core.lab.datasets.glb_objects import TURN_TO_FRONT, load_mesh, normalised, select_meshes
from core.lab.datasets.rasteriser import Surface
from core.lab.datasets.render_objects import RenderTask

_SEAT_RANGE = 0.2, 0.62  # heights, relative to the chair's, in which a seat is searched
_BINS = 64  # of the area profile, over the whole height
_HORIZONTAL = 0.8  # cosine: a face within 37 degrees of horizontal counts as part of a seat
_SEAT_DEPTH = 0.12  # of the chair's height: thickness of the slab above the cut that bounds the seat
_ACROSS, _HIGH = (0.65, 1.5), (0.8, 1.25)  # limits of the factors that scale the lower half
_MIN_SUPPORT = 0.7  # fraction of the cut through the lower half that must lie under the seat
_MARGIN = 0.02  # scene units around the seat that count as under it


class Halves(NamedTuple):
    """A chair cut below its seat. World axes, the cut at z = 0."""

    lower: tuple[Surface, ...]
    upper: tuple[Surface, ...]
    section: Float[np.ndarray, "points 2"]  # points where the cut crosses the surfaces, x and y
    seat: Float[np.ndarray, "2 2"]  # least and greatest x and y of the slab above the cut


def recombined_tasks(folder: Path | str, count: int) -> tuple[RenderTask, ...]:
    """Return render tasks of ``count`` random pairs of a folder's training meshes, deterministically.

    Each is a separate shape and texture. Raises ``ValueError`` if the meshes give fewer.
    """
    halves = {}
    for entry in select_meshes(folder, "chairs", "train"):
        found = cut_below_seat(load_mesh(entry.path, TURN_TO_FRONT.get(entry.name, 0.0)))
        if found:
            halves[entry.name] = found
    pairs = [(base, top) for base in halves for top in halves if base != top]
    tasks = list[RenderTask]()
    for index in np.random.default_rng(0).permutation(len(pairs)):
        if len(tasks) == count:
            break
        base, top = pairs[index]
        name = f"{base}+{top}"
        if recombine(halves[base], halves[top], name):
            tasks.append(RenderTask(name, name, name, partial(_recombined, halves[base], halves[top], name)))
    if len(tasks) < count:
        raise ValueError(f"{folder}: its chairs give only {len(tasks)} of {count} recombinations")
    return tuple(tasks)


def _recombined(base: "Halves", top: "Halves", name: str) -> tuple[Surface, ...]:
    found = recombine(base, top, name)
    assert found, "pairs that do not meet were left out"
    return found


def cut_below_seat(surfaces: Sequence[Surface]) -> Halves | None:
    """Cut a chair below the largest nearly horizontal area at the height of a seat.

    Returns None if there is no such area, or if nothing crosses the cut.
    """
    height = _seat_height(surfaces)
    if height is None:
        return None
    raised = [replace(surface, vertices=surface.vertices - (0.0, 0.0, height)) for surface in surfaces]
    lower, upper, sections = [], [], []
    for surface in raised:
        below, above, section = _cut(surface)
        lower += [below] if len(below.faces) else []
        upper += [above] if len(above.faces) else []
        sections.append(section)
    section = np.vstack(sections)
    if not (lower and upper and len(section)):
        return None
    points = np.vstack([surface.vertices for surface in upper])
    slab = points[points[:, 2] < _SEAT_DEPTH * np.ptp(np.vstack([s.vertices for s in raised])[:, 2])]
    if len(slab) < 3:
        return None
    return Halves(tuple(lower), tuple(upper), section, np.stack((slab[:, :2].min(0), slab[:, :2].max(0))))


def recombine(base: Halves, top: Halves, name: str) -> tuple[Surface, ...] | None:
    """Put the lower half of one chair under the upper half of another, normalised; None if they do not meet.

    Args:
        name: seeds the height of the legs.
    """
    points = np.vstack([surface.vertices for surface in base.lower])
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    size = np.maximum(top.seat[1] - top.seat[0], 1e-3)
    across = np.clip(size / np.maximum(high - low, 1e-3), *_ACROSS)
    generator = np.random.default_rng(zlib.crc32(name.encode()))
    factors = np.append(across, generator.uniform(*_HIGH))
    shift = np.append(top.seat.mean(0) - across * (low + high) / 2, 0.0)
    section = base.section * across + shift[:2]
    under = ((section > top.seat[0] - _MARGIN) & (section < top.seat[1] + _MARGIN)).all(1)
    if under.mean() < _MIN_SUPPORT:
        return None
    lower = [replace(s, vertices=s.vertices * factors + shift, normals=s.normals / factors) for s in base.lower]
    return normalised((*lower, *top.upper))


def _seat_height(surfaces: Sequence[Surface]) -> float | None:
    """Return the height just below the largest nearly horizontal area; world units."""
    triangles = np.vstack([surface.vertices[surface.faces] for surface in surfaces])
    crossed = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(crossed, axis=1) / 2
    flat = np.abs(crossed[:, 2]) > _HORIZONTAL * 2 * np.maximum(area, 1e-12)
    low, high = triangles[..., 2].min(), triangles[..., 2].max()
    relative = (triangles[..., 2].mean(1) - low) / max(high - low, 1e-9)
    profile, edges = np.histogram(relative[flat], _BINS, (0.0, 1.0), weights=area[flat])
    profile[(edges[:-1] < _SEAT_RANGE[0]) | (edges[1:] > _SEAT_RANGE[1])] = 0.0
    if profile.max() <= 0.05 * area.sum() / _BINS:
        return None
    seat = int(profile.argmax())
    # Step down from the seat's top to its bottom while the next bins hold much horizontal area.
    while seat > 0 and profile[max(0, seat - 2) : seat].max(initial=0.0) > 0.3 * profile.max():
        seat -= 1
    return float(low + (edges[seat] - 0.01) * (high - low))


def _cut(surface: Surface) -> tuple[Surface, Surface, Float[np.ndarray, "points 2"]]:
    """Split a surface at z = 0; return the parts below and above, and the crossings of its edges."""
    above = surface.vertices[:, 2] >= 0
    count = above[surface.faces].sum(1)
    whole_below, whole_above = surface.faces[count == 0], surface.faces[count == 3]
    crossing = np.flatnonzero((count == 1) | (count == 2))
    faces, lone_above = surface.faces[crossing], count[crossing] == 1
    lone = (above[faces] == lone_above[:, None]).argmax(1)
    a, b, c = (np.take_along_axis(faces, ((lone + turn) % 3)[:, None], 1)[:, 0] for turn in range(3))
    grown, p, q = _with_crossings(surface, a, b, c)
    tips, rests = np.stack((a, p, q), 1), np.vstack((np.stack((p, b, c), 1), np.stack((p, c, q), 1)))
    twice = np.concatenate((lone_above, lone_above))
    lower = np.vstack((whole_below, tips[~lone_above], rests[twice]))
    upper = np.vstack((whole_above, tips[lone_above], rests[~twice]))
    section = grown.vertices[np.concatenate((p, q)), :2]
    return _with_faces(grown, lower), _with_faces(grown, upper), section


def _with_crossings(
    surface: Surface, a: Int[np.ndarray, "cut"], b: Int[np.ndarray, "cut"], c: Int[np.ndarray, "cut"]
) -> tuple[Surface, Int[np.ndarray, "cut"], Int[np.ndarray, "cut"]]:
    """Add a vertex where the edges ab and ac cross z = 0; return the surface and the new indices."""
    z = surface.vertices[:, 2]
    start, end = np.concatenate((a, a)), np.concatenate((b, c))
    share = (z[start] / np.where(z[start] == z[end], 1.0, z[start] - z[end]))[:, None]

    def extended(values: Float[np.ndarray, "vertices size"]) -> Float[np.ndarray, "more size"]:
        return np.vstack((values, values[start] * (1 - share) + values[end] * share))

    uvs = None if surface.uvs is None else extended(surface.uvs)
    grown = replace(
        surface,
        vertices=extended(surface.vertices),
        normals=extended(surface.normals),
        colours=extended(surface.colours),
        uvs=uvs,
    )
    first = len(surface.vertices) + np.arange(len(a))
    return grown, first, first + len(a)


def _with_faces(surface: Surface, faces: Int[np.ndarray, "faces 3"]) -> Surface:
    """Return these faces of a surface, with the vertices they use."""
    used, inverse = np.unique(faces, return_inverse=True)
    rows = (surface.vertices[used], surface.normals[used], inverse.reshape(faces.shape), surface.colours[used])
    return Surface(*rows, None if surface.uvs is None else surface.uvs[used], surface.texture)
