"""Lengths that drags change."""

from dataclasses import replace

import pytest
import torch

from core.editing.bounds import Bounds
from core.editing.pull import Pull, find_pull, pull_on
from core.editing.size import SIDES, lengths, resized
from core.geometry.camera import Camera
from core.models.model import Instance, Model
from core.models.part_head import PartHead

_FRONT = Camera(1.5708, 0.1, 2.0, 300.0, 128, 128)  # width is across, height up, depth towards the viewer
_SIDE = replace(_FRONT, azimuth=0.0)  # depth is across
_BOUNDS = Bounds((-0.35, -0.35, -0.38), (0.35, 0.35, 0.38), 100.0, 0.0)


@pytest.fixture
def stool(tiny: Model) -> Instance:
    return tiny[0]


@pytest.fixture
def chair(tiny: Model) -> Instance:
    """An object whose legs end at the middle of its height."""
    width = tiny.field.config.width
    return replace(tiny, part_head=PartHead(("seat", "legs"), torch.zeros(2, width), torch.zeros(2)))[0]


@pytest.mark.parametrize(
    ("point", "drag", "name", "sign"),
    [
        ((0.0, 0.0, 0.3), (1.0, -8.0), "height", 1),  # the top, up
        ((0.0, 0.0, 0.3), (1.0, 8.0), "height", -1),
        ((0.0, 0.1, -0.05), (0.0, -8.0), "height", 1),  # below the middle, yet the object stands on the ground
        ((0.0, 0.1, -0.37), (0.0, 8.0), "height", 1),  # the feet, down
        ((-0.3, 0.0, 0.0), (8.0, 1.0), "width", 1),  # the viewer's right is -x
        ((-0.3, 0.0, 0.0), (-8.0, 1.0), "width", -1),
        ((0.3, 0.0, 0.0), (-8.0, 1.0), "width", 1),
    ],
)
def test_a_drag_away_from_the_middle_makes_larger(
    stool: Instance, point: tuple[float, float, float], drag: tuple[float, float], name: str, sign: int
) -> None:
    pull = find_pull(stool, _BOUNDS, _FRONT, "seat", point, drag)
    assert pull is not None and pull.name == name
    assert sign * (pull.to(drag) - pull.length) > 0.01 * pull.length


def test_the_axis_on_which_a_point_is_far_out_is_preferred(stool: Instance) -> None:
    camera = replace(_FRONT, azimuth=0.8, elevation=0.3)
    assert find_pull(stool, _BOUNDS, camera, "", (0.02, 0.35, 0.0), (8.0, 0.0)).name == "depth"
    assert find_pull(stool, _BOUNDS, camera, "", (0.35, 0.02, 0.0), (8.0, 0.0)).name == "width"
    assert find_pull(stool, _BOUNDS, _SIDE, "", (0.0, 0.3, 0.0), (8.0, 0.0)).name == "depth"


def test_legs_alone_grow_when_they_are_pulled(chair: Instance) -> None:
    for pulled, name in (("legs", "legs"), ("seat", "height")):
        pull = find_pull(chair, _BOUNDS, _FRONT, pulled, (0.0, 0.0, -0.37), (0.0, 8.0))
        assert pull is not None and pull.name == name and pull.to((0.0, 8.0)) > pull.length
    without_plane = _BOUNDS._replace(plane=None)
    assert find_pull(chair, without_plane, _FRONT, "legs", (0.0, 0.0, -0.37), (0.0, 8.0)).name == "height"


@pytest.mark.parametrize("axis", range(3))
def test_the_surface_follows_the_hand(stool: Instance, axis: int) -> None:
    camera = replace(_FRONT, azimuth=0.8, elevation=0.4, distance=50.0, focal=7500.0)  # nearly without perspective
    point = torch.zeros(3)
    point[axis] = _BOUNDS.high[axis]
    ends = camera.project(torch.stack((point, 1.1 * point)))
    right, down = (ends[1] - ends[0]).tolist()
    pull = pull_on(stool, _BOUNDS, camera, SIDES[axis], tuple(point.tolist()))
    assert pull is not None and pull.to((right, down)) == pytest.approx(1.1 * pull.length, rel=1e-3)
    edited = resized(stool, _BOUNDS, pull.name, pull.to((right, down)))
    assert lengths(edited, _BOUNDS)[pull.name] == pytest.approx(1.1 * pull.length, rel=1e-3)


def test_a_motion_along_the_line_of_sight_cannot_be_followed(stool: Instance) -> None:
    assert pull_on(stool, _BOUNDS, _FRONT, "depth", (0.0, 0.35, 0.0)) is None
    assert pull_on(stool, _BOUNDS, _SIDE, "depth", (0.0, 0.35, 0.0)) is not None


def test_no_drag_makes_a_length_negative() -> None:
    assert Pull("height", 90.0, (0.0, -0.01)).to((0.0, 1e6)) == pytest.approx(0.9)
