"""How long videos take: parts measured, and put together as videos are made of them."""

from dataclasses import replace

import pytest

from core.export.keyframes import Keyframe, Timeline, View, turntable
from core.export.pace import Pace, measure_pace
from core.export.video import FORMATS, Coding
from core.export.video_frames import FEW_SAMPLES
from core.models.model import Model
from core.rendering.progressive import RenderSettings
from tests.conftest import unchecked_shapes
from tests.core.tiny import tiny_model

PACE = Pace(1e-5, start=2.0, view=0.5, frame=0.01, ray=1e-7, baked=True, coding={".gif": Coding(1e-8, 1e-6)})


def turn(model: Model, frames: int = 72, size: int = 512) -> list[View]:
    return turntable(model.codes[0], model.camera(0.3, 0.4).resized(size, size), frames)


def test_every_part_of_a_video_is_measured() -> None:
    model = tiny_model()
    with unchecked_shapes():
        *before, pace = measure_pace(model, turn(model)[0])
    assert pace is not None and not any(before)
    assert pace.baked
    assert min(pace.exact, pace.start, pace.view, pace.frame, pace.ray) > 0
    assert pace.start > pace.view
    assert set(pace.coding) == set(FORMATS)
    assert all(one.frame > 0 and one.end >= 0 for one in pace.coding.values())


@pytest.mark.parametrize(("frames", "size", "rays"), [(72, 512, 512), (72, 1080, 1080), (72, 96, 384)])
def test_a_turn_takes_its_views_its_frames_and_its_rays(frames: int, size: int, rays: int) -> None:
    views = turn(tiny_model(), frames, size)
    expected = 2.0 + 0.5 * (19 - 2) + frames * (0.01 + 1e-7 * rays**2)
    assert PACE.seconds(views, ".mp4") == pytest.approx(expected)


def test_exact_frames_and_those_of_what_cannot_be_baked_are_counted_by_rays() -> None:
    views = turn(tiny_model())
    expected = 72 * 512**2 * 1e-5
    assert PACE.seconds(views, ".mp4", exact=True) == pytest.approx(expected)
    small = turn(tiny_model(), 72, 256)
    assert PACE.seconds(small[:1], ".png") == pytest.approx(256**2 * 1e-5)  # sooner than baked
    few = 4 * 256**2 * 1e-5 * FEW_SAMPLES / RenderSettings.samples
    assert PACE.seconds(small[:4], ".mp4") == pytest.approx(few)
    assert replace(PACE, baked=False).seconds(views, ".mp4") == pytest.approx(expected)


def test_every_object_of_a_morph_is_baked_unless_its_frame_is_small() -> None:
    model = tiny_model()
    camera = model.camera(0.3, 0.4)
    keys = Keyframe(0.0, View(model.codes[0], camera)), Keyframe(0.5, View(model.codes[1], camera))
    large, small = (
        [View(codes, camera.resized(size, size)) for codes, camera in Timeline(keys, 1.0).views(16)]
        for size in (1080, 512)
    )
    assert PACE.seconds(large, ".mp4") > 16 * PACE.start
    assert PACE.seconds(small, ".mp4") == pytest.approx(16 * 512**2 * 1e-5 * FEW_SAMPLES / RenderSettings.samples)


def test_what_is_written_at_the_end_takes_its_time_too() -> None:
    views = turn(tiny_model())
    more = PACE.seconds(views, ".gif") - PACE.seconds(views, ".mp4")
    assert more == pytest.approx(72 * 512**2 * 1e-6)
