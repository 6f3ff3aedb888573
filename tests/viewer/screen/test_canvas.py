import math
from dataclasses import replace

import moderngl
import numpy as np
import pytest

from core.gl.baked_field import BakedField
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Model
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.baked_reference import render_baked
from tests.core.tiny import tiny_model
from viewer.screen.canvas import Canvas
from viewer.screen.opengl_speed import is_fast
from viewer.screen.theme import DARK, LIGHT, Palette
from viewer.values.orbit import PanelCrop, fit_to_panel

WHITE = replace(LIGHT, background=((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))


@pytest.fixture(scope="module")
def stool() -> Model:
    return tiny_model()


@pytest.fixture(scope="module")
def baked(stool: Model) -> tuple[BakedField, ...]:
    return tuple(field for field in bake(stool[0]) if field)


def drawn(gl: moderngl.Context, baked: BakedField, crop: PanelCrop, palette: Palette = WHITE) -> np.ndarray:
    canvas = Canvas(gl)
    canvas.draw_baked(replace(baked, shadow=None), crop, palette)
    picture = canvas.pixels() / 255
    canvas.release()
    return picture


@pytest.mark.parametrize("pan", [(0.0, 0.0), (0.2, -0.1)])
@pytest.mark.parametrize("perspective", [True, False])
def test_the_baked_image_matches_the_reference_and_the_exact_one(
    gl: moderngl.Context, stool: Model, baked: tuple[BakedField, ...], pan: tuple[float, float], perspective: bool
) -> None:
    camera = stool.camera(0.7, 0.4)
    if not perspective:
        camera = replace(camera, distance=60.0, focal=30 * camera.focal)
    crop = fit_to_panel(camera, 120, 90, 90, pan)
    rows = slice(crop.top, crop.top + crop.height)
    columns = slice(crop.left, crop.left + crop.width)
    exact = render_exact(stool[0], crop.camera).colour[rows, columns].numpy()
    for field, min_psnr in zip(baked, (33, 38), strict=True):
        image = drawn(gl, field, crop)
        assert image.shape == (90, 120, 3)
        assert psnr(image, render_baked(field, crop.camera).colour[rows, columns].numpy()) > 42
        assert psnr(image, exact) > min_psnr


def test_any_object_is_drawn_on_the_views_background(gl: moderngl.Context, baked: tuple[BakedField, ...], stool: Model):
    crop = fit_to_panel(stool.camera(0.7, 0.4, 4.0), 80, 80, 80)
    image = drawn(gl, baked[0], crop, DARK)
    np.testing.assert_allclose(image[0, 0], DARK.background[0], atol=0.01)
    np.testing.assert_allclose(image[-1, -1], DARK.background[1], atol=0.01)
    canvas = Canvas(gl)
    for field, azimuth in ((baked[1], 0.0), (baked[1], 1.0), (baked[0], 1.0), (baked[1], 0.0)):
        crop = fit_to_panel(stool.camera(azimuth, 0.4), 60, 60, 60)
        canvas.draw_baked(replace(field, shadow=None), crop, WHITE)
        assert psnr(canvas.pixels() / 255, render_baked(field, crop.camera).colour.numpy()) > 42
    canvas.release()


def test_rays_through_corners_stay_there_and_speed_is_measured(gl: moderngl.Context) -> None:
    model = random_model(white_from_network=True)
    field = next(field for field in bake(model[0]) if field)
    crop = fit_to_panel(model.camera(0.7, 0.4), 40, 40, 40)
    assert psnr(drawn(gl, field, crop), render_baked(field, crop.camera).colour.numpy()) > 40
    assert is_fast(gl, math.inf)
    assert not is_fast(gl, 0.0)
