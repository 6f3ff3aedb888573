import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from core.edits.stretch import Stretch
from core.export.films import View, morph, swing, turntable
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.missing import MissingInstance


def shot(azimuth: float = 0.0, code: float = 0.0) -> View:
    camera = Camera(azimuth, 0.2, 1.3, 131.25, 128, 128)
    return View(MissingInstance("", Codes(torch.full((3,), code), torch.full((2,), -code))), camera)


def test_a_swing_starts_at_the_camera_slows_at_either_end_and_has_no_seam() -> None:
    instance, camera = shot(2.9)
    views = swing(instance, camera, 48)
    assert views[0] == (instance, camera)
    angles = [math.degrees(math.remainder(view.camera.azimuth - 2.9, 2 * math.pi)) for view in views]
    assert (max(angles), min(angles)) == (pytest.approx(70.0), pytest.approx(-70.0))
    steps = [abs(end - start) for start, end in pairwise([*angles, angles[0]])]
    assert max(abs(end - start) for start, end in pairwise([*steps, steps[0]])) < 1.5
    assert steps[12] < 1.0 < 9.0 < steps[0]  # at an end, and at the camera
    assert steps[-1] == pytest.approx(steps[0])
    assert {replace(view.camera, azimuth=0.0) for view in views} == {replace(camera, azimuth=0.0)}


def test_a_morph_turns_once_and_is_the_second_object_halfway() -> None:
    instance, camera = shot(0.4)
    goal = shot(code=2.0).instance.with_edits(Stretch, Stretch((1.0, 1.2, 1.0)))
    views = morph(instance, goal, camera, 8)
    assert (views[0].instance, views[4].instance) == (instance, goal)
    turned = [view.camera.azimuth - 0.4 for view in views]
    assert turned == pytest.approx([index * math.pi / 4 for index in range(8)])
    amounts = [float(view.instance.codes.shape[0]) / 2 for view in [*views, views[0]]]
    assert amounts[2] == pytest.approx(0.5)
    assert amounts == pytest.approx(amounts[::-1])  # back as it came
    assert amounts[1] < 0.15 and 1 - amounts[3] < 0.15  # slow at either object
    assert views[2].instance.codes.factors == pytest.approx((1.0, 1.1, 1.0))
    with pytest.raises(ValueError, match="different models"):
        morph(instance, MissingInstance("cars", goal.codes), camera)


@pytest.mark.parametrize("film", [swing, turntable, lambda *view: morph(view[0], *view)])
def test_a_film_without_frames_is_refused(film: Callable[..., list[View]]) -> None:
    with pytest.raises(ValueError, match="at least 1 frame"):
        film(*shot(), 0)
