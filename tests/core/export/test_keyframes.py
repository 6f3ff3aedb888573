import math
from collections.abc import Callable
from dataclasses import astuple, replace
from itertools import pairwise

import pytest
import torch

from core.edits.bend import Bend
from core.edits.stretch import Stretch
from core.edits.warp import TERMS, Warp
from core.export.keyframes import MIN_GAP, Keyframe, Timeline, View, morph, swing, turntable
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.missing import MissingInstance


def shot(azimuth: float = 0.0, elevation: float = 0.2, distance: float = 1.3, code: float = 0.0) -> View:
    camera = Camera(azimuth, elevation, distance, 131.25, 128, 128)
    return View(MissingInstance("", Codes(torch.full((3,), code), torch.full((2,), -code))), camera)


def timeline(*shots: View, **options) -> Timeline:
    """Keys a second apart from 0 on."""
    keys = tuple(Keyframe(float(index), view) for index, view in enumerate(shots))
    return Timeline(keys, **({"length": float(len(shots))} | options))


def seam(made: Timeline) -> float:
    """The step from the last frame to the first, relative to the longest step between other frames."""
    rows = torch.stack(
        [
            torch.tensor(
                [math.cos(view.camera.azimuth), math.sin(view.camera.azimuth), *view.instance.codes.shape.tolist()]
            )
            for view in made.views(24)
        ]
    )
    return float((rows[0] - rows[-1]).norm() / rows.diff(dim=0).norm(dim=1).amax().clamp_min(1e-9))


@pytest.mark.parametrize("loop", [True, False])
def test_timelines_pass_through_every_key(loop: bool) -> None:
    shots = shot(0.1, 0.2, 1.0, 1.0), shot(2.5, -0.4, 1.6, -2.0), shot(-2.8, 0.9, 1.2, 0.5)
    made = timeline(*shots, loop=loop)
    for second, expected in enumerate(shots):
        view = made.at(float(second))
        assert view.camera.azimuth == pytest.approx(expected.camera.azimuth, abs=1e-9)
        assert view.camera.elevation == pytest.approx(expected.camera.elevation)
        assert view.camera.distance == pytest.approx(expected.camera.distance)
        torch.testing.assert_close(view.instance.codes.shape, expected.instance.codes.shape)
        torch.testing.assert_close(view.instance.codes.texture, expected.instance.codes.texture)


def test_a_path_meets_its_middle_and_takes_the_short_way_round_the_sphere() -> None:
    made = timeline(shot(distance=1.0, code=0.0), shot(distance=4.0, code=2.0), loop=False)
    halfway = made.at(0.5)
    torch.testing.assert_close(halfway.instance.codes.shape, torch.ones(3))
    assert halfway.camera.distance == pytest.approx(2.0)
    made = timeline(shot(3.0), shot(-3.0), loop=False)
    for step in range(21):
        camera = made.at(step / 20).camera
        assert camera.distance == pytest.approx(1.3)
        assert abs(camera.azimuth) >= 3.0 - 1e-9  # by way of pi, not of 0


def test_loops_go_all_round_and_turns_are_added() -> None:
    thirds = [shot(2 * math.pi * third / 3) for third in range(3)]
    made = timeline(*thirds)
    steps = [made.at(0.05 * index).camera.azimuth for index in range(61)]
    turned = [math.remainder(after - before, 2 * math.pi) for before, after in pairwise(steps)]
    assert all(0 < step < 0.2 for step in turned)
    assert sum(turned) == pytest.approx(2 * math.pi)
    made = timeline(shot(code=0.0), shot(code=2.0), turns=1)
    quarter = made.at(0.5)
    assert quarter.camera.azimuth == pytest.approx(math.pi / 2)
    torch.testing.assert_close(quarter.instance.codes.shape, torch.ones(3))
    assert seam(made) < 1.5


def test_smooth_has_no_corner_and_stays_off_the_pole() -> None:
    made = timeline(shot(code=0.0), shot(code=1.0), shot(code=0.0), shot(code=-1.0))
    before, middle, after = (float(made.at(1.0 + d).instance.codes.shape[0]) for d in (-0.01, 0.0, 0.01))
    assert abs((after - middle) - (middle - before)) / 0.01 < 0.1  # of straight lines it would be 2
    high = math.radians(88)
    made = timeline(shot(elevation=0.0), shot(elevation=high), shot(elevation=high), shot(elevation=0.0))
    assert max(made.at(0.02 * index).camera.elevation for index in range(200)) <= math.radians(89.0)


def test_a_loop_has_no_seam_and_ends_before_its_beginning() -> None:
    shots = [shot(code=float(number)) for number in range(4)]
    assert seam(timeline(*shots, loop=True)) < 1.5
    assert seam(timeline(*shots, loop=False, length=3.0)) > 10
    assert seam(timeline(*shots, shots[0], loop=False)) < 1.5
    assert seam(timeline(shot(), loop=True)) < 1.5
    two = shot(code=0.0), shot(code=1.0)
    looped = timeline(*two, loop=True).views(12)
    ended = timeline(*two, loop=False).views(12)
    assert len(looped) == len(ended) == 24
    assert looped[0].instance == ended[0].instance
    assert looped[-1].instance != looped[0].instance
    torch.testing.assert_close(ended[-1].instance.codes.shape, two[1].instance.codes.shape)


def test_edits_make_new_timelines_and_keep_keys_apart() -> None:
    made = Timeline().added(0.0, shot(code=1.0)).added(2.0, shot(code=2.0)).added(1.0, shot(code=3.0))
    assert [key.seconds for key in made.keys] == [0.0, 1.0, 2.0]
    assert made.nearest(1.01) == 1
    assert made.nearest(1.5) is None
    assert len(made.added(1.0 + MIN_GAP / 2, shot()).keys) == 3
    assert [key.seconds for key in made.removed(1).keys] == [0.0, 2.0]
    assert made.moved(1, 3.5).keys[1].seconds == pytest.approx(2.0 - MIN_GAP)
    assert made.moved(2, 99.0).keys[2].seconds == pytest.approx(made.length - MIN_GAP)
    assert made.moved(0, -1.0).keys[0].seconds == 0.0
    assert [key.seconds for key in made.stretched(8.0).keys] == [0.0, 2.0, 4.0]
    assert made.stretched(0.0).length >= 3 * MIN_GAP
    ended = made.looped(False).added(4.0, shot())
    assert ended.keys[-1].seconds == 4.0
    assert ended.looped(True).keys[-1].seconds == pytest.approx(4.0 - MIN_GAP)


def test_timelines_without_keys_or_order_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one key"):
        Timeline().at(0.0)
    with pytest.raises(ValueError, match="apart"):
        Timeline((Keyframe(1.0, shot()), Keyframe(0.5, shot())))
    with pytest.raises(ValueError, match="apart"):
        Timeline((Keyframe(4.0, shot()),), loop=True)
    with pytest.raises(ValueError, match="takes"):
        replace(Timeline(), length=math.inf)


@pytest.mark.parametrize("loop", [True, False])
def test_timelines_cut_between_objects_of_two_models_and_the_camera_goes_on(loop: bool) -> None:
    def with_model(view: View, model: str, size: int) -> View:
        codes = view.instance.codes
        return View(MissingInstance(model, replace(codes, shape=codes.shape.repeat(size))), view.camera)

    plain = shot(0.0, code=0.0), shot(0.5, code=1.0), shot(1.0, code=2.0), shot(1.5, code=3.0)
    cut = timeline(
        *(with_model(view, "chairs" if n < 2 else "cars", 1 if n < 2 else 2) for n, view in enumerate(plain)), loop=loop
    )
    uncut = timeline(*plain, loop=loop)
    assert [cut.at(t).instance.fingerprint for t in (0.0, 1.0, 1.99, 2.0, 3.0, 3.9)] == ["chairs"] * 3 + ["cars"] * 3
    for seconds in (0.0, 0.7, 1.5, 2.2, 3.5):
        assert cut.at(seconds).camera == uncut.at(seconds).camera
    torch.testing.assert_close(cut.at(1.7).instance.codes.shape, torch.ones(3))  # rests on the last key before the cut
    assert 2.0 < float(cut.at(2.5).instance.codes.shape[0]) < 3.0 and len(cut.at(2.5).instance.codes.shape) == 6
    assert not loop or abs(cut.views(24)[-1].camera.azimuth - cut.views(24)[0].camera.azimuth) < 0.15


def test_a_swing_starts_at_the_camera_slows_at_either_end_and_has_no_seam() -> None:
    instance, camera = shot(2.9)
    views = swing(instance, camera, 48)
    assert views[0] == (instance, camera)
    angles = [math.degrees(math.remainder(view.camera.azimuth - 2.9, 2 * math.pi)) for view in views]
    assert (max(angles), min(angles)) == (pytest.approx(70.0), pytest.approx(-70.0))
    steps = [abs(after - before) for before, after in pairwise([*angles, angles[0]])]
    assert max(abs(after - before) for before, after in pairwise([*steps, steps[0]])) < 1.5
    assert steps[12] < 1.0 < 9.0 < steps[0]  # at an end, and at the camera
    assert steps[-1] == pytest.approx(steps[0])
    assert {replace(view.camera, azimuth=0.0) for view in views} == {replace(camera, azimuth=0.0)}


def test_a_morph_turns_once_and_is_the_other_object_halfway() -> None:
    instance, camera = shot(0.4, code=0.0)
    goal = shot(code=2.0).instance
    views = morph(instance, goal, camera, 8)
    assert (views[0].instance, views[4].instance) == (instance, goal)
    turned = [math.remainder(view.camera.azimuth - 0.4, 2 * math.pi) for view in views]
    assert turned[2] == pytest.approx(math.pi / 2) and turned[6] == pytest.approx(-math.pi / 2)


def test_sizes_change_between_keys() -> None:
    instance, camera = shot()
    wide = instance.with_edits(Stretch, Stretch((3.0, 1.0, 1.0)))
    keys = Keyframe(0.0, View(instance, camera)), Keyframe(2.0, View(wide, camera))
    video = Timeline(keys, 2.0, loop=False)
    factors = [video.at(seconds).instance.codes.factors for seconds in (0.0, 1.0, 2.0)]
    assert factors == [(1.0, 1.0, 1.0), (2.0, 1.0, 1.0), (3.0, 1.0, 1.0)]


def test_legs_change_between_keys_and_return() -> None:
    instance, camera = shot()
    bends = (), (Bend(-0.4, 0.0, 0.1, 0.4),), (Bend(-0.4, -0.1, 0.1, 0.2),), ()
    views = [View(instance.with_edits(Bend, *bend), camera) for bend in bends]
    keys = tuple(Keyframe(float(time), view) for time, view in enumerate(views))
    video = Timeline(keys, 3.0, loop=False)
    between = (Bend(-0.4, 0.0, 0.05, 0.4),), (Bend(-0.4, -0.05, 0.1, 0.3),)
    moments = {0.0: bends[0], 0.5: between[0], 1.0: bends[1], 1.5: between[1], 2.0: bends[2], 3.0: ()}
    for seconds, bend in moments.items():
        interpolated = video.at(seconds).instance.codes.edits
        assert [*map(astuple, interpolated)] == [pytest.approx(astuple(one)) for one in bend]


@pytest.mark.parametrize("film", [swing, turntable])
def test_a_video_without_frames_is_refused(film: Callable[..., list[View]]) -> None:
    with pytest.raises(ValueError, match="at least 1 frame"):
        film(*shot(), 0)


def test_sizes_and_edits_are_interpolated_in_plain_numbers() -> None:
    """Cameras and fields take their number format from them."""
    warp = Warp((1.0,), (1.0, 1.0, 1.0), ((0.0, 0.1, 0.0),) * len(TERMS), 0.2)
    view = shot()
    edited = view._replace(instance=view.instance.changed(edits=(warp, Stretch((1.0, 1.2, 1.0)))))
    for between in timeline(view, edited).views(8):
        codes = between.instance.codes
        assert all(type(factor) is float for factor in codes.factors)
        numbers = [
            number for warp in codes.of_kind(Warp) for number in (*warp.steps, *warp.coefficients[0], warp.strain)
        ]
        assert all(type(number) is float for number in numbers)
    halfway = timeline(view, edited, loop=False).at(0.5).instance.codes
    assert halfway.factors == pytest.approx((1.0, 1.1, 1.0))
    assert halfway.of_kind(Warp)[0].steps == pytest.approx((0.5,))
