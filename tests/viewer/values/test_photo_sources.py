from dataclasses import replace

import numpy as np
import pytest

from core.models.model import Model
from core.rendering.progressive import Frame
from viewer.values.photo_sources import SIDES, describe_sources, side_cameras


def frame(photo: float, mirrored: float) -> Frame:
    """Of an object that fills half of it."""
    opacity = np.zeros((8, 8), np.float32)
    opacity[2:6] = 1
    sources = opacity[..., None] * np.array([photo, mirrored], np.float32)
    return Frame(np.zeros((8, 8, 3), np.uint8), opacity, opacity, 0, 1, 8, 0.0, sources=sources)


@pytest.mark.parametrize(
    "shares, said",
    [
        ([(0.9, 0), (0.8, 0), (0, 0), (0.1, 0.6)], "Front and right side from the photo, left side from its mirror"),
        ([(0, 0), (0, 0), (0, 0), (0, 0)], "Little from the photo, the rest from other "),
        ([(0.9, 0)] * 4, "Front, right side, back and left side from the photo"),
    ],
)
def test_sides_are_told_by_where_most_of_them_is_from(
    model: Model, shares: list[tuple[float, float]], said: str
) -> None:
    text = describe_sources(model, dict(zip(SIDES, (frame(*one) for one in shares), strict=True)))
    assert text.startswith(said)
    assert ("the rest" in text) == (shares[0] != shares[2] or shares[2] == (0, 0))


def test_frames_of_no_photo_say_so(model: Model) -> None:
    bare = replace(frame(0, 0), sources=None)
    assert describe_sources(model, dict.fromkeys(SIDES, bare)).startswith("Little")
    assert {camera.width for camera in side_cameras(model).values()} == {32}
