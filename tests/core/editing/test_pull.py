"""Directions of drags, by the words for sizes."""

from dataclasses import replace

import pytest

from core.editing.pull import Pull, find_pull
from core.geometry.camera import Camera
from core.models.model import Instance, Model

_FRONT = Camera(1.5708, 0.1, 2.0, 300.0, 128, 128)  # width is across, height up, depth towards the viewer
_SIDE = replace(_FRONT, azimuth=0.0)  # depth is across
_WORDS = ("", "lower", "wider", "longer")


@pytest.fixture
def stool(tiny: Model) -> Instance:
    return tiny[0]


@pytest.mark.parametrize(
    ("point", "drag", "word", "sign"),
    [
        ((0.0, 0.0, 0.3), (1.0, -8.0), "lower", -1),  # the top, up
        ((0.0, 0.0, 0.3), (1.0, 8.0), "lower", 1),
        ((0.0, 0.1, -0.05), (0.0, -8.0), "lower", -1),  # below the middle, yet the object stands on the ground
        ((0.0, 0.1, -0.38), (0.0, 8.0), "lower", -1),  # the feet, down
        ((-0.3, 0.0, 0.0), (8.0, 1.0), "wider", 1),  # the viewer's right is -x
        ((-0.3, 0.0, 0.0), (-8.0, 1.0), "wider", -1),
        ((0.3, 0.0, 0.0), (-8.0, 1.0), "wider", 1),
    ],
)
def test_a_drag_away_from_the_middle_makes_larger(
    stool: Instance, point: tuple[float, float, float], drag: tuple[float, float], word: str, sign: int
) -> None:
    pull = find_pull(stool, _WORDS, _FRONT, point, drag)
    assert _WORDS[pull.direction] == word
    assert pull.amount(drag) * sign > 0.1


def test_the_axis_on_which_a_point_is_far_out_is_preferred(stool: Instance) -> None:
    camera = replace(_FRONT, azimuth=0.8, elevation=0.3)
    assert find_pull(stool, _WORDS, camera, (0.02, 0.35, 0.0), (8.0, 0.0)).direction == 3
    assert find_pull(stool, _WORDS, camera, (0.35, 0.02, 0.0), (8.0, 0.0)).direction == 2
    assert find_pull(stool, _WORDS, _SIDE, (0.0, 0.3, 0.0), (8.0, 0.0)).direction == 3


def test_without_words_for_sizes_a_drag_follows_the_first_direction(stool: Instance) -> None:
    assert find_pull(stool, ("", "rounder"), _FRONT, (0.0, 0.0, 0.3), (0.0, -8.0)).direction == 0
    assert find_pull(stool, (), _FRONT, (0.0, 0.0, 0.3), (0.0, -8.0)).amount((0.0, -8.0)) > 0.1
    only_wider = find_pull(stool, ("wider",), _FRONT, (0.0, 0.0, 0.3), (0.0, -8.0))
    assert only_wider.direction == 0


def test_three_hundredths_of_the_image_are_a_standard_deviation(stool: Instance) -> None:
    pull = find_pull(stool, _WORDS, _FRONT, (0.0, 0.0, 0.3), (0.0, -8.0))
    assert pull.amount((0.0, -3.84)) == pytest.approx(-1.0, abs=0.01)
    assert Pull(2, (10.0, -20.0)).amount((20.0, 10.0)) == pytest.approx(0.0)
