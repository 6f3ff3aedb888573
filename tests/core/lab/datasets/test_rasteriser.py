"""The rasteriser draws where core.geometry.rays looks, covers what it should, and lights plausibly."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from core.geometry.camera import Camera
from core.geometry.rays import camera_rays
from core.lab.datasets.rasteriser import DAYLIGHT, Rasteriser, Surface

SIZE = 64
DARK = np.tile(np.array([0, 0, 0, 255], np.uint8), (2, 2, 1))
GREY = 128 / 255


def camera(azimuth: float, elevation: float, distance: float = 1.3) -> Camera:
    return Camera(azimuth, elevation, distance, 65.625, SIZE, SIZE)


def dot(centre: np.ndarray, radius: float) -> Surface:
    """Return a black octahedron."""
    vertices = np.concatenate((np.eye(3), -np.eye(3))) * radius + centre
    faces = np.array([(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)])
    return Surface(vertices, np.zeros((6, 3)), faces, np.zeros((6, 3)))


def grey(mesh: trimesh.Trimesh) -> Surface:
    return Surface(mesh.vertices, mesh.vertex_normals, np.asarray(mesh.faces), np.full(mesh.vertices.shape, GREY))


@pytest.mark.parametrize("azimuth", [-2.5, 0.0, math.pi / 2, 2.0])
@pytest.mark.parametrize("elevation", [-0.9, 0.0, 0.6, math.pi / 2])
def test_a_point_is_rendered_where_its_ray_passes(rasteriser: Rasteriser, azimuth: float, elevation: float) -> None:
    view = camera(azimuth, elevation)
    rays = camera_rays(view, torch.tensor([0.5, 0.5, 0.5]))
    for row, column in ((20, 44), (50, 13), (32, 32)):
        centre = (rays.origins + 1.25 * rays.directions)[row, column].double().numpy()
        rasteriser.upload([dot(centre, 0.03)])
        image, mask = rasteriser.render(view)
        dark = 255.0 - image.mean(-1)
        y, x = np.mgrid[:SIZE, :SIZE] + 0.5
        assert (dark * x).sum() / dark.sum() == pytest.approx(column + 0.5, abs=0.08)
        assert (dark * y).sum() / dark.sum() == pytest.approx(row + 0.5, abs=0.08)
        assert mask[row, column]


def test_coverage_is_the_covered_fraction_of_the_pixel(rasteriser: Rasteriser) -> None:
    """A black square seen face on: its area in pixels is known, and its edges are grey by their coverage."""
    side = 0.3
    corners = np.array([(-side, -side, 0), (side, -side, 0), (side, side, 0), (-side, side, 0)], float) / 2
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    rasteriser.upload([Surface(corners, np.zeros((4, 3)), faces, np.zeros((4, 3)))])
    image, mask = rasteriser.render(camera(0.3, math.pi / 2))
    expected = (side * 65.625 / 1.3) ** 2
    assert (1 - image[..., 0] / 255.0).sum() == pytest.approx(expected, rel=0.02)
    assert mask.sum() == pytest.approx(expected, rel=0.05)
    assert np.array_equal(mask, image[..., 0] < 128)
    assert ((image > 20) & (image < 235)).any()


def test_near_hides_far_on_a_white_background_out_of_the_mask(rasteriser: Rasteriser) -> None:
    rasteriser.upload([dot(np.zeros(3), 0.1)])
    image, mask = rasteriser.render(camera(0, 0))
    assert (image[:8] == 255).all()
    assert not mask[:8].any()
    rasteriser.upload([])
    image, mask = rasteriser.render(camera(0, 0))
    assert (image == 255).all()
    assert not mask.any()
    black = dot(np.zeros(3), 0.1)
    behind = dot(np.array([0, 0.3, 0]), 0.1)
    white = Surface(behind.vertices, behind.normals, behind.faces, np.ones((6, 3)))
    rasteriser.upload([white, black])
    assert rasteriser.render(camera(math.pi / 2, 0))[0][32, 32].min() > 120
    assert rasteriser.render(camera(-math.pi / 2, 0))[0][32, 32].max() == 0


def test_both_sides_of_a_face_are_lit(rasteriser: Rasteriser) -> None:
    """Neither the winding of triangles nor the sign of normals makes a difference."""
    sphere = grey(trimesh.creation.icosphere(2, 0.2))
    images = []
    for variant in (sphere, replace(sphere, faces=sphere.faces[:, ::-1]), replace(sphere, normals=-sphere.normals)):
        rasteriser.upload([variant])
        images.append(rasteriser.render(camera(0.7, 0.5))[0].astype(int))
    assert np.abs(images[0] - images[1]).max() <= 1
    assert np.abs(images[0] - images[2]).max() <= 1


def expected(normal: np.ndarray) -> float:
    """Return the sRGB level of a grey face in daylight, in double precision."""
    low, high = DAYLIGHT["sky"]
    power = low + (high - low) * (0.5 + 0.5 * normal[2])
    back = np.array([0.2, -1.0, 0.2]) / np.linalg.norm((0.2, -1.0, 0.2))
    for towards, peak in zip((DAYLIGHT["key"], DAYLIGHT["fill"], back), DAYLIGHT["powers"], strict=True):
        power += peak * max(float(normal @ towards), 0.0)
    linear = min(((GREY + 0.055) / 1.055) ** 2.4 * power, 1.0)
    return 255 * (1.055 * linear ** (1 / 2.4) - 0.055)


def test_a_face_has_the_colour_of_the_formula(rasteriser: Rasteriser) -> None:
    box = trimesh.creation.box((0.3, 0.3, 0.3))
    box.unmerge_vertices()
    rasteriser.upload([grey(box)])
    faces = [(a, 0.0) for a in (0, math.pi / 2, math.pi, -math.pi / 2)] + [(0.0, math.pi / 2), (0.0, -math.pi / 2)]
    for azimuth, elevation in faces:
        c = math.cos(elevation)
        normal = np.array([c * math.cos(azimuth), c * math.sin(azimuth), math.sin(elevation)])
        level = rasteriser.render(camera(azimuth, elevation))[0][32, 32, 0]
        assert float(level) == pytest.approx(expected(normal), abs=1.0)


def test_a_texture_is_the_right_way_up_and_cut_out_where_clear(rasteriser: Rasteriser) -> None:
    """A wall that faces +y with an image on it: red top left, green top right, blue below, a hole bottom right."""
    corners = np.array([(0.2, 0, 0.2), (-0.2, 0, 0.2), (-0.2, 0, -0.2), (0.2, 0, -0.2)])
    uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    image = np.zeros((32, 32, 4), np.uint8)
    image[:16, :16] = 255, 0, 0, 255
    image[:16, 16:] = 0, 255, 0, 255
    image[16:, :16] = 0, 0, 255, 255
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    rasteriser.upload([Surface(corners, np.zeros((4, 3)), faces, np.ones((4, 3)), uvs, image)])
    image, mask = rasteriser.render(camera(math.pi / 2, 0))
    quarters = {(r, c): image[r, c].argmax() for r, c in ((27, 27), (27, 37), (37, 27))}
    assert list(quarters.values()) == [0, 1, 2]
    assert image[37, 37].min() == 255
    assert not mask[37, 37]


def test_inconsistent_surfaces_and_cameras_are_refused(rasteriser: Rasteriser) -> None:
    three = np.zeros((3, 3))
    with pytest.raises(ValueError, match="point at"):
        Surface(three, three, np.array([(0, 1, 3)]), three)
    with pytest.raises(ValueError, match="texture coordinates"):
        Surface(three, three, np.array([(0, 1, 2)]), three, None, DARK)
    with pytest.raises(ValueError, match="finite"):
        Surface(three + math.nan, three, np.array([(0, 1, 2)]), three)
    with pytest.raises(ValueError, match="renders 64 px"):
        rasteriser.render(camera(0, 0).resized(32, 32))
