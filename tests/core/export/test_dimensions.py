import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.editing.bounds import natural_bounds
from core.editing.size import shown_bounds, sized
from core.export.dimensions import dimension_lines, draw_dimensions, with_room
from core.export.films import View, turntable
from core.export.framing import filling_frame
from core.export.video import VideoSettings, write_video
from core.models.model import Instance, Model


@pytest.fixture(scope="module")
def stool(tiny: Model) -> Instance:
    return sized(tiny[0], width=60.0, depth=58.0, height=92.0)


@pytest.mark.parametrize("unit", ["cm", "in"])
@pytest.mark.parametrize("degrees", [30, 120, 210, 300])
def test_lines_stand_at_the_near_sides_of_the_box_with_their_lengths(stool: Instance, degrees: int, unit: str) -> None:
    camera = stool.model.camera(math.radians(degrees), 0.3).resized(200, 160)
    box = shown_bounds(stool, natural_bounds(stool))
    lines = dimension_lines(box, camera, unit)
    labels = {"cm": ["60 cm", "58 cm", "92 cm"], "in": ["23.6 in", "22.8 in", "36.2 in"]}
    assert [line.label for line in lines] == labels[unit]
    corners = torch.cartesian_prod(*torch.tensor([box.low, box.high]).T)
    pixels = camera.project(corners).numpy()
    lowest = pixels[np.argmax(pixels[:, 1])]  # the near corner of the floor
    for line, axis in zip(lines, range(3), strict=True):
        corner_index = [np.linalg.norm(pixels - end, axis=1).argmin() for end in line.ends]
        np.testing.assert_allclose(pixels[corner_index], line.ends, atol=1e-3)
        first, second = corners[corner_index]
        assert [int(number) for number in (first != second).nonzero().flatten()] == [axis]
        assert line.outward @ (line.ends.mean(0) - pixels.mean(0)) > 0
    for line in lines[:2]:
        assert np.abs(line.ends - lowest).sum(1).min() < 1e-3
    upright = lines[2].ends[:, 0].mean()
    assert min(upright - pixels[:, 0].min(), pixels[:, 0].max() - upright) < 0.25 * np.ptp(pixels[:, 0])


def test_a_side_that_points_at_the_camera_has_no_line(stool: Instance) -> None:
    camera = stool.model.camera(math.pi / 2, 0.0)
    lines = dimension_lines(shown_bounds(stool, natural_bounds(stool)), camera, "cm")
    assert [line.label for line in lines] == ["60 cm", "92 cm"]


@pytest.mark.parametrize(("ground", "channels", "ink"), [(255, 3, 60), (0, 3, 235), (0, 4, 60)])
def test_lines_are_seen_on_any_ground_and_inside_the_frame(
    stool: Instance, ground: int, channels: int, ink: int
) -> None:
    camera = stool.model.camera(0.7, 0.3).resized(256, 256)
    (view,) = with_room(filling_frame([View(stool, camera)]))
    blank = np.full((256, 256, channels), ground, np.uint8)
    drawn = draw_dimensions(blank, view, "cm")
    assert drawn.shape == blank.shape
    changed = (drawn != blank).any(-1)
    assert 300 < changed.sum() < 6000
    assert not changed[[0, -1]].any() and not changed[:, [0, -1]].any()
    assert (np.abs(drawn[changed][:, :3].astype(int) - ink).max(-1) < 30).sum() > 20


def test_the_last_frame_of_a_film_stays_with_dimensions(stool: Instance, tmp_path: Path) -> None:
    views = with_room(filling_frame(turntable(stool, stool.model.camera(0.7, 0.3).resized(96, 96), 3)))
    frames = []
    for name, unit in (("plain", ""), ("sized", "cm")):
        list(write_video(views, tmp_path / f"{name}.frames", VideoSettings(rate=2, unit=unit)))
        paths = sorted((tmp_path / f"{name}.frames").iterdir())
        frames.append([np.asarray(Image.open(path)) for path in paths])
    plain, with_lines = frames
    assert (len(plain), len(with_lines)) == (3, 3 + 2 * 2)
    for frame, same in zip(plain[:2], with_lines[:2], strict=True):
        np.testing.assert_array_equal(frame, same)
    assert (plain[2] != with_lines[2]).any()
    for frame in with_lines[3:]:
        np.testing.assert_array_equal(frame, with_lines[2])
    gif = tmp_path / "turn.gif"
    list(write_video(views, gif, replace(VideoSettings(), rate=2, unit="cm")))
    with Image.open(gif) as film:
        assert film.n_frames >= 3
