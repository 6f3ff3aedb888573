"""The ground shadow against explicit sums, and its drawing by OpenGL against the computed one."""

import math
from typing import Any

import moderngl
import numpy as np
import pytest
import torch

from core.detail.progressive import Frame, RenderJob, RenderSettings, render_progressively
from core.export.films import turntable
from core.export.video_frames import baked_frames, exact_frames, over
from core.geometry.camera import Camera
from core.gl.ground_shader import GroundShader
from core.metrics import psnr_from_mse
from core.models.model import Model
from core.rendering.ground_shadow import GroundShadow, cast_shadow
from tests.conftest import random_model

EXTENT = 0.5, 0.4, 0.5
SIDE = 2 / 64


def rendered(model: Model, camera: Camera) -> Frame:
    job = RenderJob(model[0], camera, RenderSettings(divisors=(1,)), shadow=True)
    *_, frame = render_progressively(job)
    assert frame
    return frame


def plate(bottom: int, thick: int = 2) -> torch.Tensor:
    """A square of 16 x 16 corners in the middle, ``bottom`` above the lowest layer, and four posts from that layer."""
    density = torch.full((65, 65, 65), 1e-2)
    density[24:40, 24:40, 10 + bottom : 10 + bottom + thick] = 1e2
    for x, y in ((4, 4), (60, 4), (4, 60), (60, 60)):  # far away, so that they hide nothing of the middle
        density[x : x + 2, y : y + 2, 10:12] = 1e2
    return density


@pytest.fixture
def shadow() -> GroundShadow:
    return solid_shadow(plate(8))


def solid_shadow(density: torch.Tensor) -> GroundShadow:
    shadow = cast_shadow(density, EXTENT)
    assert shadow
    return shadow


def test_darkness_is_the_fraction_of_the_sky_that_a_plate_hides(shadow: GroundShadow) -> None:
    """Light from a direction of zenith angle a weighs cos(a)^6: its integral over the plate, as seen from below."""
    height = 12 * SIDE * EXTENT[2]  # the slab from 8 to 16 layers
    x, y = (torch.arange(-32, 33) * SIDE * half for half in EXTENT[:2])
    offsets = (torch.arange(256) + 0.5 - 128) * SIDE / 2
    for row, column in ((128, 128), (112, 144), (160, 132)):
        square = (x[24:40, None] - EXTENT[0] * offsets[column]) ** 2 + (y[24:40] - EXTENT[1] * offsets[row]) ** 2
        light = height**6 / (square + height**2) ** 4 * 3 / math.pi * (SIDE * EXTENT[0]) * (SIDE * EXTENT[1])
        assert shadow.darkness[row, column] == pytest.approx(255 * 0.7 * float(light.sum()), rel=0.05, abs=1)
    assert shadow.reach == (1.0, 0.8)
    assert shadow.height == pytest.approx(EXTENT[2] * (9.5 * SIDE - 1))
    edges = shadow.darkness[[0, -1]], shadow.darkness[:, [0, -1]]
    assert max(int(edge.max()) for edge in edges) == 0


def test_lower_plates_are_darker_and_specks_cast_no_shadow() -> None:
    shadows = [solid_shadow(plate(height)) for height in (1, 4, 20)]
    middles = [int(shadow.darkness[120:136, 120:136].max()) for shadow in shadows]
    assert middles == sorted(middles, reverse=True)
    assert middles[0] > 2 * middles[-1] > 0
    speck = torch.full((65, 65, 65), 1e-2)
    speck[3, 3, 2] = 1e2
    assert cast_shadow(speck, EXTENT) is None
    low = plate(8)
    low[30, 30, 1] = 1e2
    assert solid_shadow(low).height == pytest.approx(EXTENT[2] * (9.5 * SIDE - 1))


def test_contact_shadows_are_dark_and_narrow_and_haze_casts_none() -> None:
    density = plate(20)
    density[28:36, 28:36, 10:13] = 1e2  # a foot
    density[44:52, 28:36, 10:13] = 0.4  # haze
    row = solid_shadow(density).darkness[128].astype(int)
    row_without = solid_shadow(plate(20)).darkness[128].astype(int)
    # A corner is two texels wide, and the map reaches half of the grid beyond the grid.
    edge = 64 + 71
    assert row[128] > 200
    assert row[edge] > row[edge + 9] + 60
    assert abs(row[edge + 9] - row_without[edge + 9]) < 25
    hazy = 64 + 2 * 48
    assert abs(row[hazy] - row_without[hazy]) < 10


@pytest.mark.parametrize("layer", [0, 1, 30])
@pytest.mark.parametrize(("below", "above", "height"), [(1e-2, 1e2, 0.5), (1e-3, 10.0, 0.75), (0.99, 1e2, 0.0)])
def test_the_ground_lies_where_the_object_ends_between_two_layers(
    layer: int, below: float, above: float, height: float
) -> None:
    density = torch.zeros(65, 65, 65)
    density[20:40, 20:40, layer:] = above
    if layer:
        density[20:40, 20:40, layer - 1] = below
    density[24, 24, max(layer - 1, 0)] = 5.0  # a speck below
    expected = layer - 1 + height if layer else 0.0
    assert solid_shadow(density).height == pytest.approx(EXTENT[2] * (expected * SIDE - 1), abs=0.02 * SIDE)


def drawn(
    gl: moderngl.Context, shadow: GroundShadow, camera: Camera, size: tuple[int, int], *section: Any, **ring: Any
) -> np.ndarray:
    """The pixels that OpenGL draws over white."""
    texture = gl.texture(size, 4)
    target = gl.framebuffer([texture])
    shader = GroundShader(gl)
    target.use()
    target.clear(1.0, 1.0, 1.0, 1.0)
    shader.draw(shadow, camera, size, *section, **ring)
    pixels = np.frombuffer(texture.read(), np.uint8).reshape(*size[::-1], 4)
    for resource in (shader, target, texture):
        resource.release()
    return pixels


@pytest.mark.parametrize("elevation", [-1.2, -0.5, 0.02, 0.3, 1.5])
def test_opengl_draws_the_computed_shadow(gl: moderngl.Context, shadow: GroundShadow, elevation: float) -> None:
    """Drawn in a section of the camera's image; from below the ground, there is no shadow."""
    camera = Camera(0.7, elevation, 1.6, 90.0, 96, 96)
    expected = shadow.seen_by(camera).numpy()
    pixels = drawn(gl, shadow, camera, (64, 48), (20, 40))[..., 0] / 255
    assert np.abs(pixels - (1 - expected[40:88, 20:84])).max() < 0.012
    assert (expected.max() > 0.02) == (elevation > 0)


def test_a_ring_is_green_where_a_photo_saw_the_object(shadow: GroundShadow, gl: moderngl.Context) -> None:
    overhead = Camera(0.0, math.pi / 2 - 1e-3, 3.0, 300.0, 200, 200)
    pixels = drawn(gl, shadow, overhead, (200, 200), azimuths=(math.pi / 2,)).astype(int)
    green = pixels[..., 1] - pixels[..., 0] > 60
    grey = (np.ptp(pixels[..., :3], axis=-1) < 8) & (np.abs(pixels[..., 0] - 150) < 25)
    between = np.nonzero(green)[1].mean() - np.nonzero(grey)[1].mean()
    assert between > 25  # px: y points to the right, seen from above at azimuth 0


def test_the_shadow_lies_between_object_and_background(tiny: Model) -> None:
    camera = tiny.camera(0.3, 0.5).resized(48, 48)
    frame = rendered(tiny, camera)
    assert frame.shadow
    lost = frame.shadow.seen_by(camera).numpy()[..., None]
    assert lost.max() > 0.2
    opacity = frame.opacity[..., None]
    background = np.array([90, 160, 220])
    expected = frame.image - 255 * (1 - opacity) + (1 - opacity) * (1 - lost) * background
    assert np.abs(over(frame, (90, 160, 220), camera) - expected).max() <= 1
    clear = over(frame, None, camera).astype(float)
    alpha = clear[..., 3:] / 255
    assert np.abs(clear[..., :3] * alpha + background * (1 - alpha) - expected).max() <= 3


def test_baked_and_exact_frames_have_the_same_shadow_if_it_is_switched_on(tiny: Model) -> None:
    views = turntable(tiny[0], tiny.camera(0.3, 0.4).resized(64, 64), 4)[:2]
    baked, exact, without = (
        [image for image in frames if image is not None]
        for frames in (
            baked_frames(views, (255, 255, 255), True),
            exact_frames(views, (255, 255, 255), True),
            baked_frames(views, (255, 255, 255), False),
        )
    )
    for image, exact_image, plain in zip(baked, exact, without, strict=True):
        assert psnr_from_mse(float(np.square((image - exact_image.astype(float)) / 255).mean())) > 42
        assert (plain.astype(int) - image).max() > 8
        assert (image <= plain.astype(int) + 1).all()  # a shadow only darkens


def test_a_network_that_paints_the_background_has_no_shadow() -> None:
    model = random_model(1, white_from_network=True)
    assert rendered(model, model.camera(0.3, 0.4)).shadow is None
