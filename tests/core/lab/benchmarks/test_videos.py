from pathlib import Path

import pytest

from core.export.video_frames import FEW_SAMPLES
from core.lab.benchmarks import videos
from core.lab.benchmarks.charts import draw
from core.lab.benchmarks.csv_files import append_record
from core.lab.benchmarks.videos import VideoTiming, measure_videos
from tests.conftest import image_size, unchecked_shapes
from tests.core.tiny import tiny_model

COMMON = {"machine": "a machine", "category": "chairs", "objects": "1", "frames": "12", "size": "64", "image": "96"}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.export.video_frames.FEW_PIXELS", 48**2)
    for name, value in (
        ("SIZE", 48),
        ("IMAGE_SIZE", 96),
        ("FRAMES", 4),
        ("COMPARED", (1,)),
        ("SAMPLES", (8, 64)),
        ("REFERENCE_SAMPLES", 128),
        ("GRIDS", (128,)),
        ("CELLS", 128),
    ):
        monkeypatch.setattr(videos, name, value)


@pytest.mark.usefixtures("small")
def test_every_way_to_make_a_video_is_measured_once() -> None:
    with unchecked_shapes():
        rows = list(measure_videos(tiny_model(), 2))
        assert [row.key for row in rows] == [
            *(("turn", "exact", samples) for samples in (8, 64)),
            ("turn", "baked", 128),
            ("turn", "default", 0),
            *((kind, *recipe) for kind in ("morph", "image") for recipe in (("exact", 64), ("default", 0))),
        ]
        assert all(row.seconds > 0 and row.worst <= row.psnr for row in rows)
        coarse, fine, baked, default = rows[:4]
        assert fine.psnr > coarse.psnr
        assert default.setting == 128 and default.psnr == baked.psnr > 35
        assert rows[5].setting == FEW_SAMPLES  # an object of a morph has one frame
        assert list(measure_videos(tiny_model(), 2, [row.key for row in rows])) == []


def test_timings_become_a_chart_and_a_table(tmp_path: Path) -> None:
    for row in (
        VideoTiming("turn", "exact", 192, 60.0, 55.0, 54.0),
        VideoTiming("turn", "baked", 192, 3.0, 46.0, 45.0),
        VideoTiming("turn", "default", 192, 4, 46, 45),
    ):
        append_record(tmp_path / "videos.csv", COMMON, row)
    table = draw(tmp_path, "videos")
    assert "| turn | baked | 192 | 3.0 | 20.0 | 46.0 | 45.0 |" in table
    width, height = image_size(tmp_path / "videos.png")
    assert width > height > 100
