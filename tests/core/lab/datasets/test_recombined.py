from dataclasses import replace

import numpy as np
import pytest

from core.lab.datasets.rasteriser import Surface
from core.lab.datasets.recombined import cut_below_seat, recombine


def box(low: tuple[float, float, float], high: tuple[float, float, float], grey: float = 0.5) -> Surface:
    corners = np.array([[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    return Surface(corners, np.zeros((8, 3)), faces, np.full((8, 3), grey))


def chair(width: float, legs: float, grey: float = 0.5) -> tuple[Surface, ...]:
    """Four legs up to a seat, and a back."""
    seat = box((-width / 2, -0.2, legs), (width / 2, 0.2, legs + 0.05), grey)
    back = box((-width / 2, -0.2, legs), (width / 2, -0.17, legs + 0.5), grey)
    feet = [
        box((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, legs + 0.01), grey)
        for x in (0.02 - width / 2, width / 2 - 0.02)
        for y in (-0.18, 0.18)
    ]
    return seat, back, *feet


def corners(surfaces: tuple[Surface, ...]) -> np.ndarray:
    return np.vstack([surface.vertices[np.unique(surface.faces)] for surface in surfaces])


def test_a_chair_is_cut_just_below_its_seat() -> None:
    halves = cut_below_seat(chair(0.4, 0.4))
    assert halves is not None
    lower, upper = corners(halves.lower), corners(halves.upper)
    assert lower[:, 2].max() <= 1e-9
    assert upper[:, 2].min() >= -1e-9
    assert -0.4 <= lower[:, 2].min() < -0.3
    np.testing.assert_allclose(halves.seat, [[-0.2, -0.2], [0.2, 0.2]], atol=1e-6)
    assert len(halves.section) == 4 * 4 * 4  # four legs of four sides of two triangles, two crossings each


def test_the_cut_keeps_every_area() -> None:
    whole = chair(0.4, 0.4)
    halves = cut_below_seat(whole)
    assert halves is not None

    def area(surfaces: tuple[Surface, ...]) -> float:
        triangles = np.vstack([surface.vertices[surface.faces] for surface in surfaces])
        sides = triangles[:, 1:] - triangles[:, :1]
        return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)

    assert area((*halves.lower, *halves.upper)) == pytest.approx(area(whole), rel=1e-9)


def test_legs_of_one_stand_under_the_seat_of_the_other() -> None:
    dark, light = cut_below_seat(chair(0.3, 0.5, 0.1)), cut_below_seat(chair(0.4, 0.3, 0.9))
    assert dark is not None
    assert light is not None
    made = recombine(dark, light, "dark+light")
    assert made is not None
    points = corners(made)
    assert np.linalg.norm(points.max(0) - points.min(0)) == pytest.approx(1.0)
    legs = corners(tuple(one for one in made if one.colours[0, 0] < 0.5))
    seat = corners(tuple(one for one in made if one.colours[0, 0] > 0.5))
    assert legs[:, 2].max() == pytest.approx(seat[:, 2].min(), abs=1e-6)
    np.testing.assert_allclose(legs[:, :2].max(0), seat[:, :2].max(0), atol=0.02)
    again = recombine(dark, light, "dark+light")
    assert again is not None
    np.testing.assert_array_equal(corners(again), points)


def test_halves_that_do_not_meet_are_refused() -> None:
    one = cut_below_seat(chair(0.4, 0.4))
    assert one is not None
    far = replace(box((0.0, 0.0, -0.4), (0.01, 0.01, 0.0)), colours=np.zeros((8, 3)))
    assert recombine(one._replace(lower=(far,), section=np.full((4, 2), 9.0)), one, "far") is None


def test_a_plank_has_no_seat() -> None:
    assert cut_below_seat((box((-0.01, -0.01, 0.0), (0.01, 0.01, 1.0)),)) is None
