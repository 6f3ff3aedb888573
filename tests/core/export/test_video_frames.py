"""Frames from a baked copy against the exact ones."""

from itertools import pairwise
from typing import NoReturn

import numpy as np
import pytest

from core.export import video_frames
from core.export.keyframes import Keyframe, Timeline, View, turntable
from core.export.video_frames import BakedViews, bake_views, baked_frames, exact_frames, key_views, supersampling
from core.metrics import psnr, psnr_from_mse
from core.models.model import Model
from core.rendering.offscreen import OffscreenRenderer
from core.rendering.reference import render_exact
from tests.conftest import unchecked_shapes
from tests.core.tiny import tiny_model

SIZE = 64


def turn(model: Model, frames: int = 24) -> tuple[View, ...]:
    return turntable(model.codes[0], model.camera(0.3, 0.4).resized(SIZE, SIZE), frames)


def images(stream) -> list[np.ndarray]:
    return [image for image in stream if image is not None]


def test_drawn_frames_are_the_exact_ones() -> None:
    """A third of a turn in four steps, and between two of five degrees, where frames are mixtures."""
    model = tiny_model()
    views = (*turn(model, 12)[:4], *turn(model, 72)[18:21])
    drawn = images(baked_frames(model, views, (255, 255, 255)))
    exact = images(exact_frames(model, views, (255, 255, 255)))
    assert len(drawn) == len(exact) == len(key_views(views)) + 2
    for one, other in zip(drawn, exact, strict=True):
        assert psnr_from_mse(float(np.square((one - other.astype(float)) / 255).mean())) > 42


def test_a_transparent_background_has_the_exact_opacity() -> None:
    model = tiny_model()
    views = turn(model, 2)
    for drawn, exact in zip(*(images(make(model, views, None)) for make in (baked_frames, exact_frames)), strict=True):
        assert drawn.shape == exact.shape == (SIZE, SIZE, 4)
        assert np.abs(drawn[..., 3].astype(float) - exact[..., 3]).mean() < 4


def test_a_background_changes_towards_the_lower_edge_as_that_of_exact_frames_does() -> None:
    model = tiny_model()
    views, gradient = turn(model, 2), ((240, 230, 220), (20, 30, 40))
    for drawn, exact in zip(
        *(images(make(model, views, gradient)) for make in (baked_frames, exact_frames)), strict=True
    ):
        assert np.abs(drawn[:, 0].astype(int) - exact[:, 0]).max() <= 1
        assert (drawn[0, 0] == gradient[0]).all()
        assert np.abs(drawn[-1, 0].astype(int) - gradient[1]).max() <= 1
        assert psnr_from_mse(float(np.square((drawn - exact.astype(float)) / 255).mean())) > 42


def test_a_wide_frame_is_drawn_as_rendered() -> None:
    model = tiny_model()
    views = [View(codes, camera.resized(2 * SIZE, SIZE)) for codes, camera in turn(model, 1)]
    (drawn,), (exact,) = (images(make(model, views, (255, 255, 255))) for make in (baked_frames, exact_frames))
    assert drawn.shape == exact.shape == (SIZE, 2 * SIZE, 3)
    assert psnr(drawn / 255, exact / 255) > 42


def test_without_opengl_frames_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> NoReturn:
        raise RuntimeError("no OpenGL")

    monkeypatch.setattr(video_frames, "OffscreenRenderer", refuse)
    model = tiny_model()
    views = turn(model, 2)
    drawn, exact = (images(make(model, views, None)) for make in (baked_frames, exact_frames))
    assert all(np.array_equal(one, other) for one, other in zip(drawn, exact, strict=True))


@pytest.mark.parametrize("cells", [128, 192])
def test_haze_is_as_near_on_a_finer_grid(cells: int) -> None:
    """Many thin layers of it add up: none may be without its colour."""
    model = tiny_model()
    views = turn(model, 1)
    stream = BakedViews(model, views, cells).at(0)
    with pytest.raises(StopIteration) as ended, unchecked_shapes():
        while True:
            next(stream)
    with OffscreenRenderer((SIZE, SIZE)) as pictures:
        drawn = pictures.draw(ended.value.value, views[0].camera) / 255
    assert psnr(drawn, render_exact(model, *views[0]).colour) > 44


def test_what_no_grid_is_fine_enough_for_is_not_baked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_frames, "LEVELS", video_frames.LEVELS[:2])
    stream = bake_views(tiny_model(), turn(tiny_model(), 2), target=200.0)
    with pytest.raises(StopIteration) as ended:
        while True:
            next(stream)
    assert ended.value.value is None


def test_key_views_are_near_enough_to_one_another() -> None:
    model = tiny_model()
    views = turn(model, 72)
    keys = key_views(views)
    assert (keys[0], keys[-1]) == (0, 71)
    assert 71 / 5 <= len(keys) <= 71  # of 5 degrees each, less than 20 apart
    assert all(after - before <= 4 for before, after in pairwise(keys))
    assert key_views(views[:1]) == [0]


def test_a_morph_has_key_views_of_its_own() -> None:
    model = tiny_model()
    camera = model.camera(0.3, 0.4)
    keys = Keyframe(0.0, View(model.codes[0], camera)), Keyframe(0.5, View(model.codes[1], camera))
    morph = Timeline(keys, 1.0).views(16)
    still = [View(model.codes[0], view.camera) for view in morph]
    assert key_views(morph) == list(range(16))
    assert len(key_views(still)) == 2


@pytest.mark.parametrize(("size", "rays"), [(64, 4), (256, 2), (512, 1), (1080, 1)])
def test_small_frames_have_several_rays_in_a_pixel(size: int, rays: int) -> None:
    assert supersampling(tiny_model().camera(0.3, 0.4).resized(2 * size, size)) == rays
