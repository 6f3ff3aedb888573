"""Frames from a baked copy against the exact ones."""

from typing import NoReturn

import numpy as np
import pytest

from core.export import video_frames
from core.export.films import View, swing, turntable
from core.export.video_frames import baked_frames, exact_frames, render_frames, rendered_pixels, supersampling
from core.metrics import psnr, psnr_from_mse
from core.models.model import Model
from tests.core.tiny import tiny_model

SIZE = 64


def turn(model: Model, frames: int = 24) -> tuple[View, ...]:
    return turntable(model[0], model.camera(0.3, 0.4).resized(SIZE, SIZE), frames)


def images(stream) -> list[np.ndarray]:
    return [image for image in stream if image is not None]


def test_drawn_frames_are_the_exact_ones() -> None:
    """A full turn of an object, whose colours are combined from fewer cameras, and a frame of another object."""
    model = tiny_model()
    views = (*turn(model, 12), View(model[1], model.camera(2.0, -0.3).resized(SIZE, SIZE)))
    drawn = images(baked_frames(views, (255, 255, 255)))
    exact = images(exact_frames(views, (255, 255, 255)))
    assert len(drawn) == len(exact) == len(views)
    for baked_image, exact_image in zip(drawn, exact, strict=True):
        assert psnr_from_mse(float(np.square((baked_image - exact_image.astype(float)) / 255).mean())) > 42


def test_a_transparent_background_has_the_exact_opacity() -> None:
    model = tiny_model()
    views = turn(model, 2)
    for drawn, exact in zip(*(images(make(views, None)) for make in (baked_frames, exact_frames)), strict=True):
        assert drawn.shape == exact.shape == (SIZE, SIZE, 4)
        assert np.abs(drawn[..., 3].astype(float) - exact[..., 3]).mean() < 4


def test_a_background_changes_towards_the_lower_edge_as_that_of_exact_frames_does() -> None:
    model = tiny_model()
    views = turn(model, 2)
    gradient = (240, 230, 220), (20, 30, 40)
    for drawn, exact in zip(*(images(make(views, gradient)) for make in (baked_frames, exact_frames)), strict=True):
        assert np.abs(drawn[:, 0].astype(int) - exact[:, 0]).max() <= 1
        assert (drawn[0, 0] == gradient[0]).all()
        assert np.abs(drawn[-1, 0].astype(int) - gradient[1]).max() <= 1
        assert psnr_from_mse(float(np.square((drawn - exact.astype(float)) / 255).mean())) > 42


def test_a_wide_frame_is_drawn_as_rendered() -> None:
    model = tiny_model()
    views = [View(instance, camera.resized(2 * SIZE, SIZE)) for instance, camera in turn(model, 1)]
    (drawn,), (exact,) = (images(make(views, (255, 255, 255))) for make in (baked_frames, exact_frames))
    assert drawn.shape == exact.shape == (SIZE, 2 * SIZE, 3)
    assert psnr(drawn / 255, exact / 255) > 42


def test_without_opengl_frames_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> NoReturn:
        raise RuntimeError("no OpenGL")

    monkeypatch.setattr(video_frames, "OffscreenRenderer", refuse)
    model = tiny_model()
    views = turn(model, 2)
    drawn, exact = (images(make(views, None)) for make in (baked_frames, exact_frames))
    assert all(np.array_equal(*pair) for pair in zip(drawn, exact, strict=True))


@pytest.mark.parametrize(("size", "rays"), [(64, 4), (256, 2), (512, 1), (1080, 1)])
def test_small_frames_have_several_rays_in_a_pixel(size: int, rays: int) -> None:
    assert supersampling(tiny_model().camera(0.3, 0.4).resized(2 * size, size)) == rays


def test_the_way_back_of_a_swing_is_rendered_once(monkeypatch: pytest.MonkeyPatch) -> None:
    model = tiny_model()
    views = swing(model[0], model.camera(0.3, 0.4).resized(SIZE, SIZE), 12)
    rendered = list[View]()

    def counted(views, *others, **named):
        rendered.extend(views)
        return exact_frames(views, *others, **named)

    monkeypatch.setattr(video_frames, "exact_frames", counted)
    frames = images(render_frames(views, None, exact=True))
    assert len(frames) == 12
    assert len(rendered) == len(set(views)) == 7
    for view, frame in zip(views, frames, strict=True):
        assert np.array_equal(frame, *images(exact_frames([view], None)))
    assert rendered_pixels(views) == rendered_pixels(rendered)
