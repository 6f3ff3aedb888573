"""Carving: pieces of a mesh add up to it, and their borders lie where the region's do."""

import math

import numpy as np
import pytest
import trimesh

from core.lab.datasets.procedural.carving import carve, inset, joined, mirrored
from core.lab.datasets.procedural.solids import Points, Solid, line, slab, tube


def area(solid: Solid) -> float:
    return float(trimesh.Trimesh(solid.vertices, solid.faces, process=False).area)


def sheet(count: int = 21) -> Solid:
    """The unit square at z = 1, from x = 0 to 1."""
    x, y = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    points = np.stack((x, y, np.ones_like(x)), -1).reshape(-1, 3)
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    faces = np.concatenate((np.stack((a, a + 1, a + count + 1), -1), np.stack((a, a + count + 1, a + count), -1)))
    return Solid(points, faces, points)


def test_a_disc_cut_from_a_sheet_has_its_area_and_leaves_the_rest() -> None:
    inside, rest = carve(sheet(), [lambda p: 0.3 - np.hypot(p[:, 0] - 0.5, p[:, 1] - 0.5)])
    assert area(inside) == pytest.approx(math.pi * 0.09, rel=0.01)
    assert area(inside) + area(rest) == pytest.approx(1)
    assert np.hypot(*(inside.vertices[:, :2] - 0.5).T).max() < 0.3 + 1e-9


def test_a_gap_narrower_than_the_mesh_is_found() -> None:
    inside, rest = carve(sheet(5), [lambda p: p[:, 0] - 0.6, lambda p: 0.61 - p[:, 0]])
    assert area(inside) == pytest.approx(0.01)
    assert area(rest) == pytest.approx(0.99)


def test_a_region_elsewhere_takes_nothing_and_cuts_nothing() -> None:
    whole = slab(1.0, 1.0, 0.2, 0.1, 0.05)
    inside, rest = carve(whole, [lambda p: p[:, 0] - 2.0, lambda p: p[:, 1]])
    assert len(inside.faces) == 0
    assert len(rest.faces) == len(whole.faces)


def test_faces_keep_their_side() -> None:
    whole = tube(line((0, 0, 0), (0, 0, 1), 5), 0.3)
    inside, rest = carve(whole, [lambda p: p[:, 0] + 0.1, lambda p: p[:, 2] - 0.4])
    mesh = trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    together = joined([inside, rest])
    assert trimesh.Trimesh(together.vertices, together.faces, process=False).volume == pytest.approx(mesh.volume)


def test_a_sunk_piece_has_a_bottom_and_walls_but_none_on_the_mirror_plane() -> None:
    hole, rest = carve(sheet(), [lambda p: 0.5 - p[:, 0], lambda p: p[:, 1] - 0.2, lambda p: 0.6 - p[:, 1]])

    def down(p: Points) -> Points:
        return p - (0, 0, 0.1)

    pit = inset(hole, down)
    # Bottom 0.5 x 0.4; two walls 0.5 x 0.1 and one 0.4 x 0.1.
    assert area(pit) == pytest.approx(0.2 + 0.1 + 0.04)
    assert area(mirrored(joined([pit, rest]))) == pytest.approx(2 * (1 + 0.14))
