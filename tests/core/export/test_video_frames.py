"""Frames from a baked copy against the exact ones."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NoReturn

import numpy as np
import pytest

from core.export import video_frames
from core.export.films import View, swing, turntable
from core.export.video_frames import baked_frames, exact_frames, render_frames, rendered_pixels, supersampling
from core.gl.background import Background
from core.metrics import psnr
from core.models.model import Model

SIZE = 64


def turn(model: Model, frames: int, size: tuple[int, int] = (SIZE, SIZE)) -> list[View]:
    return turntable(model[0], model.camera(0.3, 0.4).resized(*size), frames)


def images(stream: Iterable[np.ndarray | None]) -> list[np.ndarray]:
    return [image for image in stream if image is not None]


def both(views: Sequence[View], background: Background | None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield each frame as drawn from a baked copy, and as rendered."""
    return zip(*(images(make(views, background)) for make in (baked_frames, exact_frames)), strict=True)


def test_drawn_frames_are_the_exact_ones(tiny: Model) -> None:
    """A full turn of an object, whose colours are combined from fewer cameras, and a frame of another object."""
    views = (*turn(tiny, 12), View(tiny[1], tiny.camera(2.0, -0.3).resized(SIZE, SIZE)))
    qualities = [psnr(drawn / 255, exact / 255) for drawn, exact in both(views, (255, 255, 255))]
    assert len(qualities) == len(views) and min(qualities) > 42


def test_a_transparent_background_has_the_exact_opacity(tiny: Model) -> None:
    for drawn, exact in both(turn(tiny, 2), None):
        assert drawn.shape == exact.shape == (SIZE, SIZE, 4)
        assert np.abs(drawn[..., 3].astype(float) - exact[..., 3]).mean() < 4


def test_a_wide_background_changes_towards_the_lower_edge_as_that_of_exact_frames_does(tiny: Model) -> None:
    gradient = (240, 230, 220), (20, 30, 40)
    for drawn, exact in both(turn(tiny, 2, (2 * SIZE, SIZE)), gradient):
        assert drawn.shape == exact.shape == (SIZE, 2 * SIZE, 3)
        assert np.abs(drawn[:, 0].astype(int) - exact[:, 0]).max() <= 1
        assert (drawn[0, 0] == gradient[0]).all()
        assert np.abs(drawn[-1, 0].astype(int) - gradient[1]).max() <= 1
        assert psnr(drawn / 255, exact / 255) > 42


def test_without_opengl_frames_are_exact(tiny: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> NoReturn:
        raise RuntimeError("no OpenGL")

    monkeypatch.setattr(video_frames, "OffscreenRenderer", refuse)
    assert all(np.array_equal(*pair) for pair in both(turn(tiny, 2), None))


@pytest.mark.parametrize(("size", "rays"), [(64, 4), (256, 2), (512, 1), (1080, 1)])
def test_small_frames_have_several_rays_in_a_pixel(size: int, rays: int, tiny: Model) -> None:
    assert supersampling(tiny.camera(0.3, 0.4).resized(2 * size, size)) == rays


def test_the_way_back_of_a_swing_is_rendered_once(tiny: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    views = swing(tiny[0], tiny.camera(0.3, 0.4).resized(SIZE, SIZE), 12)
    rendered = list[View]()

    def counted(views, *arguments, **named):
        rendered.extend(views)
        return exact_frames(views, *arguments, **named)

    monkeypatch.setattr(video_frames, "exact_frames", counted)
    frames = images(render_frames(views, None, exact=True))
    assert len(frames) == 12
    assert len(rendered) == len(set(views)) == 7
    for view, frame in zip(views, frames, strict=True):
        assert np.array_equal(frame, *images(exact_frames([view], None)))
    assert rendered_pixels(views) == rendered_pixels(rendered)
