import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from core.edits.bend import Bend
from core.edits.stretch import Stretch
from core.geometry.camera import Camera, Factors
from core.gl.baked_field import BakedField
from core.gl.baking import MAX_TURN, BakedViews, bake, bake_views, prefilter, spread
from core.metrics import psnr
from core.models.model import Model
from core.rendering.reference import render_exact
from core.streams import run_to_end
from tests.conftest import offscreen, random_model, with_contrast
from tests.core.baked_reference import render_baked
from tests.core.tiny import tiny_model


@cache
def baked(shape: int, texture: int) -> BakedField:
    """The coarsest baked field of an object."""
    model = tiny_model()
    return next(filter(None, bake(model[shape].mixed(model[texture], 0.0, 1.0))))


@pytest.mark.parametrize("contrast", [0.0, 20.0])
def test_renders_of_baked_fields_approach_the_exact_one_with_more_cells(tiny: Model, contrast: float) -> None:
    tiny = with_contrast(tiny, contrast)
    camera = tiny.camera(0.7, 0.4).resized(96, 64)
    exact = render_exact(tiny[0], camera)
    values = list(bake(tiny[0]))
    assert values.count(None) > 4  # in small steps
    coarse, fine = filter(None, values)
    assert (coarse.cells, fine.cells) == (64, 128)
    rendered = render_baked(fine, camera)
    assert psnr(rendered.colour, exact.colour) > psnr(render_baked(coarse, camera).colour, exact.colour) > 40
    solid = exact.opacity > 0.99
    assert solid.sum() > 200
    np.testing.assert_allclose(rendered.opacity, exact.opacity, atol=0.05)
    np.testing.assert_allclose(rendered.depth[solid], exact.depth[solid], atol=0.02)


@pytest.mark.parametrize("stretch", [(2.0, 1.0, 0.5), (0.6, 1.1, 1.5)])
def test_a_stretched_object_has_the_same_texels_and_another_picture(tiny: Model, stretch: Factors) -> None:
    stool = tiny[0].with_edits(Stretch, Stretch(stretch))
    camera = tiny.camera(0.7, 0.4).resized(96, 64)
    exact = render_exact(stool, camera)
    *_, fine = filter(None, bake(stool))
    *_, natural = filter(None, bake(tiny[0]))
    np.testing.assert_array_equal(fine.texels, natural.texels)
    assert psnr(render_baked(fine, camera).colour, exact.colour) > 40
    views = run_to_end(bake_views(stool, [camera], 128))
    assert psnr(render_baked(views.seen_from(camera), camera).colour, exact.colour) > 40
    with offscreen((96, 64)) as pictures:
        image = torch.from_numpy(pictures.draw(replace(fine, shadow=None), camera).copy()).float() / 255
    assert psnr(image, exact.colour) > 40
    assert fine.shadow.height == pytest.approx(natural.shadow.height * stool.codes.proportions[2])
    assert fine.shadow.reach[0] == pytest.approx(natural.shadow.reach[0] * stool.codes.proportions[0])


def test_a_bent_object_is_baked_as_it_is_rendered(tiny: Model) -> None:
    bend = Bend(-0.35, -0.05, 0.1, 0.35)
    stool = tiny[0].changed(edits=(bend, Stretch((1.0, 1.0, 1.3))))
    camera = tiny.camera(0.7, 0.4).resized(96, 64)
    *_, fine = filter(None, bake(stool))
    *_, natural = filter(None, bake(tiny[0]))
    assert psnr(render_baked(fine, camera).colour, render_exact(stool, camera).colour) > 40
    assert psnr(render_baked(natural, camera).colour, render_exact(stool, camera).colour) < 35
    ground = float(bend.destinations(torch.tensor([0.0, 0.0, natural.shadow.height]))[2])
    assert fine.shadow.height == pytest.approx(ground * stool.codes.proportions[2], abs=0.005)


@pytest.mark.parametrize("perspective", [True, False])
def test_views_from_near_and_without_perspective_match_exact_ones(tiny: Model, perspective: bool) -> None:
    camera = tiny.camera(2.0, -0.5, 0.8).resized(48, 80)
    if not perspective:
        camera = replace(camera, distance=60.0, focal=75 * camera.focal)
    assert psnr(render_baked(baked(1, 1), camera).colour, render_exact(tiny[1], camera).colour) > 36


def test_a_new_texture_changes_colours_alone_and_pixel_offsets_are_kept() -> None:
    first = baked(0, 0)
    second = baked(0, 2)
    np.testing.assert_array_equal(first.texels[..., 3], second.texels[..., 3])
    np.testing.assert_array_equal(first.distance, second.distance)
    assert np.abs(first.texels[..., :3].astype(int) - second.texels[..., :3]).max() > 50
    model = random_model(white_from_network=True)
    assert next(filter(None, bake(model[0]))).pixel_offset == 0.5


def test_interpolated_prefiltered_values_of_a_parabola_are_unbiased() -> None:
    """Prefiltering changes neither a straight line nor values without neighbours."""
    positions = torch.arange(9.0)
    values = torch.stack((positions**2, 3 * positions - 1), -1)
    neighbours = torch.stack((torch.arange(9) - 1, torch.arange(9) + 1), -1)
    neighbours[0] = 0
    neighbours[-1] = 8
    filtered = prefilter(values, torch.cat((neighbours, *[torch.arange(9)[:, None]] * 4), -1))
    between = torch.linspace(1, 7, 6001, dtype=torch.double)
    error = np.interp(between, positions, filtered[:, 0]) - (between**2).numpy()
    assert abs(error.mean()) < 1e-3 < 0.1 < np.interp(between, positions, values[:, 0]).mean() - (between**2).mean()
    torch.testing.assert_close(filtered[:, 1], values[:, 1])
    torch.testing.assert_close(filtered[[0, 8]], values[[0, 8]])


@pytest.mark.parametrize("cells", [128, 192])
def test_haze_is_accurate_on_finer_grids(cells: int, tiny: Model) -> None:
    """Many thin layers of haze add up, so every layer needs its colour."""
    camera = tiny.camera(0.3, 0.4).resized(64, 64)
    views = run_to_end(bake_views(tiny[0], [camera], cells))
    drawn = render_baked(views.seen_from(camera), camera).colour
    assert psnr(drawn, render_exact(tiny[0], camera).colour) > 44


def test_colours_between_cameras_interpolate_a_smooth_function(tiny: Model) -> None:
    """Along a turn of cameras; the colours of a single camera serve all views."""
    ring = [tiny.camera(turn, 0.3) for turn in np.linspace(0, 2 * math.pi, 72, endpoint=False)]
    views = run_to_end(bake_views(tiny[0], ring, 64))
    assert len(views.cameras) == 16

    def smooth(camera: Camera) -> float:
        x, y, z = (camera.pose()[:3, 3] / camera.distance).tolist()
        return 0.5 + 0.2 * x - 0.1 * y * z + 0.3 * (x * x - y * y)

    values = torch.tensor([smooth(camera) for camera in views.cameras])
    painted = replace(views, colours=values[:, None, None].expand_as(views.colours))
    for camera in ring[1::5]:
        texels = painted.seen_from(camera).texels[views.shape.corners.unbind(-1)]
        np.testing.assert_allclose(texels[:, :3] / 255, smooth(camera), atol=0.01)
    alone: BakedViews = replace(views, cameras=views.cameras[:1], colours=views.colours[:1])
    np.testing.assert_array_equal(alone.seen_from(ring[9]).texels, alone.mean().texels)


def test_every_camera_has_a_baked_one_nearby(tiny: Model) -> None:
    ring = [tiny.camera(turn, 0.3) for turn in np.linspace(0, 4 * math.pi, 144, endpoint=False)]
    selected = spread(ring)
    assert len(selected) == 16  # the second turn adds none
    assert spread(ring[:1]) == spread(ring[:1] * 3) == ring[:1]
    assert len(spread([ring[0], ring[2], ring[5]])) == 2
    for camera in ring:
        distances = [math.dist(camera.pose()[:3, 3], baked_camera.pose()[:3, 3]) for baked_camera in selected]
        assert min(distances) < MAX_TURN * camera.distance
