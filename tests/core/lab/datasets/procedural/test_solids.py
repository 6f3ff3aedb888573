"""Solids: closed, the right way out, and as large as their measures say."""

import math

import numpy as np
import pytest
import trimesh

from core.lab.datasets.procedural.solids import (
    Solid,
    bar,
    line,
    moved,
    rounded_path,
    shell,
    slab,
    surface,
    tube,
    turned,
    warped,
)

GREY = np.full((4, 4, 4), 128, np.uint8)
BENT = rounded_path([(0, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 1)])


def sheet() -> np.ndarray:
    """A quarter of a cylinder of radius 1."""
    angle, height = np.meshgrid(np.linspace(0, math.pi / 2, 40), np.linspace(0, 1, 5))
    return np.stack((np.cos(angle), np.sin(angle), height), -1)


SOLIDS = {
    "slab": (slab(1.0, 0.8, 0.1, 0.001, 0.001), 0.08),
    "disc": (slab(2.0, 2.0, 0.1, 1.0, 0.001), math.pi * 0.1),
    "cushion": (slab(1.0, 1.0, 0.2, 0.1, 0.09, dome=0.03), 0.2),
    "tapered": (slab(1.0, 1.0, 0.1, 0.001, 0.001, taper=0.5), 0.075),
    "bar": (bar(line((0, 0, 0), (0, 0, 2)), 0.1, 0.2), 0.04),
    "narrowing bar": (bar(line((0, 0, 0), (0, 2, 0), 9), 0.2, 0.2, end=0.5), 0.04 * 2 * 7 / 12),
    "tube": (tube(line((0, 0, 0), (1, 1, 1), 5), 0.1, 40), math.pi * 0.01 * math.sqrt(3)),
    "bent tube": (tube(BENT, 0.02, 40), math.pi * 0.0004 * 2.6),
    "cone": (tube(line((0, 0, 0), (0, 0, 1)), [0.3, 1e-6], 60), math.pi * 0.03),
    # The half circle along the rim, pi / 2 + pi / 2 + 1 + 1 long, comes on top of the sheet.
    "shell": (shell(sheet(), 0.1), 0.1 * math.pi / 2 + 0.5 * math.pi * 0.05**2 * (math.pi + 2)),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_hold_their_volume(name: str) -> None:
    solid, volume = SOLIDS[name]
    mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, rel=0.1)


def test_moving_turning_and_mirroring_keep_the_volume() -> None:
    solid = slab(1.0, 0.5, 0.2, 0.05, 0.02)
    swapped = warped(solid, lambda points: points[:, [0, 2, 1]], mirrors=True)
    for changed in (moved(solid, (1, 2, 3)), turned(solid, 2, 0.7), swapped):
        mesh = trimesh.Trimesh(changed.vertices, changed.faces, process=False)
        assert mesh.volume == pytest.approx(trimesh.Trimesh(solid.vertices, solid.faces).volume)
        assert np.array_equal(changed.local, solid.local)


def test_a_turn_is_counter_clockwise() -> None:
    point = Solid(np.array([(1.0, 0.0, 0.0)]), np.zeros((0, 3), int), np.zeros((1, 3)))
    assert turned(point, 2, math.pi / 2).vertices[0] == pytest.approx(np.array([0, 1, 0]))


def test_normals_are_unit_outward_smooth_on_rounds_and_creased_at_edges() -> None:
    drum = surface([tube(line((0, 0, 0), (0, 0, 1)), 0.2, 24)], GREY, 1.0)
    assert np.linalg.norm(drum.normals, axis=-1) == pytest.approx(np.ones(len(drum.normals)))
    radial = drum.vertices * (1, 1, 0) / 0.2
    round_side = np.abs(drum.normals[:, 2]) < 0.5
    ends = ~round_side
    assert (drum.normals * radial).sum(-1)[round_side] == pytest.approx(np.ones(round_side.sum()), abs=2e-3)
    assert np.abs(drum.normals[ends, 2]) == pytest.approx(np.ones(ends.sum()))


def test_a_pattern_lies_on_a_bent_bar_as_on_a_straight_one() -> None:
    straight, bent = tube(line((0, 0, 0), (0, 0, 1), len(BENT)), 0.02), tube(BENT, 0.02)
    length = float(np.linalg.norm(np.diff(BENT, axis=0), axis=1).sum())
    assert straight.local[:, 2].max() == pytest.approx(1)
    assert bent.local[:, 2].max() == pytest.approx(length)
    painted = surface([bent], GREY, 0.5)
    assert painted.uvs is not None
    assert painted.uvs[:, 1].max() == pytest.approx(length / 0.5)


def test_a_rounded_path_keeps_its_ends() -> None:
    assert BENT[0].tolist() == [0, 0, 0]
    assert BENT[-1].tolist() == [1, 1, 1]
    assert np.linalg.norm(np.diff(BENT, axis=0), axis=1).min() > 1e-3
