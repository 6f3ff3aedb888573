from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import Frame, RenderJob, RenderSettings, render_progressively
from core.geometry.camera import Camera
from core.geometry.rays import camera_rays
from core.models.model import Model
from viewer.values.view_modes import MODES, in_mode, normals

CAMERA = Camera(0.7, 0.4, 2.0, 131.25, 64, 64)


@pytest.fixture
def ball() -> Frame:
    """A solid ball of radius 0.4 around the origin, as a camera sees it."""
    rays = camera_rays(CAMERA, torch.ones(3))
    origins = rays.origins.numpy()
    directions = rays.directions.numpy()
    distance = -(origins * directions).sum(-1)
    aside = ((origins + distance[..., None] * directions) ** 2).sum(-1)
    hit = aside < 0.16
    depth = np.where(hit, distance - np.sqrt(np.clip(0.16 - aside, 0, None)), 0).astype(np.float32)
    image = np.full((64, 64, 3), 255, np.uint8)
    image[hit] = 40
    return Frame(image, depth, hit.astype(np.float32), 0, 1, 192, 0.1, 3 * hit.astype(np.int32))


def test_normals_of_a_ball_point_from_its_middle(ball: Frame) -> None:
    directions = normals(ball, CAMERA)
    is_ball = directions.any(-1)
    assert is_ball.sum() > 500
    rays = camera_rays(CAMERA, torch.ones(3))
    points = rays.origins.numpy() + ball.depth[..., None] * rays.directions.numpy()
    expected = points / np.linalg.norm(points, axis=-1, keepdims=True)
    assert (directions * expected).sum(-1)[is_ball].min() > 0.9
    assert (directions * expected).sum(-1)[is_ball].mean() > 0.995
    np.testing.assert_allclose(np.linalg.norm(directions[is_ball], axis=-1), 1.0, atol=1e-6)


def test_near_is_brighter_and_opacity_and_samples_fill_the_image(ball: Frame) -> None:
    brightness = in_mode(ball, CAMERA, "depth").image.astype(int).sum(-1)
    edge = np.flatnonzero(ball.opacity[32])[1]
    assert brightness[32, 32] > brightness[32, edge] + 100
    assert (brightness[ball.opacity == 0] == 3 * 255).all()
    for mode in ("opacity", "samples"):
        frame = in_mode(ball, CAMERA, mode)
        assert (frame.opacity == 1).all()
        assert frame.image[32, 32].sum() > frame.image[0, 0].sum() + 200
    assert in_mode(ball, CAMERA, "colour") is ball


def test_a_source_has_its_tint(ball: Frame) -> None:
    is_ball = ball.opacity > 0.5
    tints = []
    for photo, mirrored in ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0)):
        sources = ball.opacity[..., None] * np.array([photo, mirrored], np.float32)
        image = in_mode(replace(ball, sources=sources), CAMERA, "source").image
        assert (image[ball.opacity == 0] == 255).all()
        tints.append(image[is_ball].mean(0))
    green, blue, grey = tints
    assert green.argmax() == 1 and blue.argmax() == 2 and np.ptp(grey) < 2
    np.testing.assert_array_equal(in_mode(ball, CAMERA, "source").image[is_ball].mean(0), grey)


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_shows_an_empty_frame(mode: str) -> None:
    empty = np.zeros((2, 3), np.float32)
    nothing = Frame(np.full((2, 3, 3), 255, np.uint8), empty, empty, 0, 1, 8, 0.1)
    changed = in_mode(nothing, CAMERA, mode)
    assert changed.image.shape == (2, 3, 3)
    assert np.isfinite(normals(nothing, CAMERA)).all()


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_takes_what_the_renderer_gives(mode: str, model: Model) -> None:
    camera = model.camera(0.4, 0.3).resized(24, 20)
    (frame,) = filter(None, render_progressively(RenderJob(model[0], camera, RenderSettings(24, (1,)))))
    assert frame.evaluations.shape == (20, 24)
    assert frame.evaluations.max() > 0
    assert (frame.evaluations[frame.opacity > 0] > 0).all()
    assert in_mode(frame, camera, mode).image.dtype == np.uint8
