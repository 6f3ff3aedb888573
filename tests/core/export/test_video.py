import gc
from bisect import bisect
from contextlib import closing
from itertools import accumulate
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from core.detail.progressive import render_frame
from core.export.films import turntable
from core.export.video import FORMATS, VideoSettings, shown_views, write_video
from core.export.video_frames import over
from core.models.model import Model


def turn(
    model: Model, path: Path, frames: int = 5, exact: bool = True, size: tuple[int, int] = (32, 32), **options: Any
):
    """Write a turn, of exact frames by default: a few of them are the fastest."""
    views = turntable(model[0], model.camera(0.0, 0.3).resized(*size), frames)
    return write_video(views, path, VideoSettings(exact=exact, **options))


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_turntable_is_a_video_of_that_many_frames(suffix: str, model: Model, tmp_path: Path) -> None:
    path = tmp_path / f"turn{suffix}"
    counts = list(turn(model, path, 5, size=(31, 31)))
    assert counts == sorted(counts)
    assert set(counts) == {0, 1, 2, 3, 4, 5}
    if suffix == ".mp4":
        with av.open(str(path)) as video:
            assert video.streams.video[0].codec_context.name == "h264"
            images = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        assert (len(images), images[0].shape) == (5, (30, 30, 3))
        # The first frame and the third look at different sides.
        assert abs(images[0].astype(int) - images[2]).max() > 5
    elif suffix == ".frames":
        assert sorted(entry.name for entry in path.iterdir()) == [f"{index:05d}.png" for index in range(5)]
    else:
        with Image.open(path) as video:
            assert (video.n_frames, video.size) == (5, (31, 31))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_frames_are_of_a_baked_copy_unless_exact(tiny: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("core.export.video_frames.FEW_PIXELS", 0)
    images = list[np.ndarray]()
    for exact in (False, True):
        list(turn(tiny, tmp_path / f"{exact}.frames", 1, exact))
        with Image.open(tmp_path / f"{exact}.frames/00000.png") as image:
            images.append(np.asarray(image).astype(int))
    assert 0 < np.abs(images[0] - images[1]).max() < 25
    assert np.array_equal(images[1], render_frame(tiny[0], tiny.camera(0.0, 0.3).resized(32, 32)).image)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_cancelled_video_keeps_the_file_that_existed(suffix: str, model: Model, tmp_path: Path) -> None:
    path = tmp_path / f"turn{suffix}"
    if suffix != ".frames":
        path.write_text("before")
    names = [entry.name for entry in tmp_path.iterdir()]
    stream = turn(model, path, 5)
    next(stream)
    stream.close()
    assert [entry.name for entry in tmp_path.iterdir()] == names
    assert not names or path.read_text() == "before"


def test_frames_are_not_written_into_an_existing_folder(model: Model, tmp_path: Path) -> None:
    (tmp_path / "turn.frames").mkdir()
    with pytest.raises(ValueError, match="exists already"):
        next(turn(model, tmp_path / "turn.frames"))
    assert not list((tmp_path / "turn.frames").iterdir())


@pytest.mark.parametrize("suffix", [name for name, kind in FORMATS.items() if kind.transparent])
def test_the_background_can_be_transparent(suffix: str, model: Model, tmp_path: Path) -> None:
    path = tmp_path / f"turn{suffix}"
    list(turn(model, path, 2, background=None))
    opacity = render_frame(model[0], model.camera(0.0, 0.3).resized(32, 32)).opacity
    with Image.open(path / "00000.png" if suffix == ".frames" else path) as image:
        alpha = np.asarray(image.convert("RGBA"))[..., 3]
    expected = 255 * (opacity >= 0.5) if suffix == ".gif" else 255 * opacity
    assert np.abs(alpha - expected.astype(float)).mean() < 2
    assert alpha.min() == 0


def test_a_transparent_gif_has_no_shadow(tiny: Model, tmp_path: Path) -> None:
    views = turntable(tiny[0], tiny.camera(0.3, 1.0, 1.5 * tiny.distance).resized(48, 48), 2)
    files = list[Path]()
    for shadow, background in ((True, None), (False, None), (True, (255, 255, 255)), (False, (255, 255, 255))):
        files.append(tmp_path / f"{shadow}{background is None}.GIF")
        list(write_video(views, files[-1], VideoSettings(background=background, shadow=shadow)))
    transparent, bare, white, plain = (path.read_bytes() for path in files)
    assert transparent == bare
    assert white != plain


def test_backgrounds_can_have_a_colour(model: Model, tmp_path: Path) -> None:
    list(turn(model, tmp_path / "a.frames", 2, background=(10, 120, 200)))
    frame = render_frame(model[0], model.camera(0.0, 0.3).resized(32, 32))
    with Image.open(tmp_path / "a.frames/00000.png") as image:
        written = np.asarray(image).astype(float)
    opacity = frame.opacity[..., None]
    assert np.abs(written - (frame.image - (1 - opacity) * (255 - np.array([10, 120, 200])))).max() <= 1
    assert np.array_equal(over(frame, (255, 255, 255)), frame.image)


def delays(path: Path) -> list[int]:
    """Return the milliseconds of each frame of an animation."""
    durations = []
    with Image.open(path) as video:
        for index in range(video.n_frames):
            video.seek(index)
            video.load()
            durations.append(video.info["duration"])
    return durations


@pytest.mark.parametrize(
    ("suffix", "rate", "frames", "written"),
    [
        *((suffix, 30, 15, 15) for suffix in (".gif", ".webp")),
        (".gif", 50, 15, 15),
        (".gif", 60, 30, 25),
        (".gif", 100, 30, 15),
        (".webp", 60, 30, 30),
        (".webp", 90, 36, 36),
        (".webp", 100, 30, 27),
    ],
)
def test_a_video_has_its_duration(suffix: str, rate: int, frames: int, written: int, model: Model, tmp_path: Path):
    """And delays that browsers keep: they show a frame of 10 ms, and of gif one below 20 ms, for 100 ms."""
    counts = list(turn(model, tmp_path / f"turn{suffix}", frames, size=(16, 16), rate=rate))
    durations = delays(tmp_path / f"turn{suffix}")
    assert len(durations) == counts[-1] == written
    assert sum(durations) == pytest.approx(1000 * frames / rate, abs=1)
    assert min(durations) >= (20 if suffix == ".gif" else 11)


def test_frames_that_a_format_cannot_show_are_those_in_between(model: Model) -> None:
    views = turntable(model[0], model.camera(0.0, 0.3), 12)
    assert shown_views(views, Path("a.GIF"), 100) == views[::2]
    assert shown_views(views, Path("a.gif"), 60) == [*views[:1], *views[2:7], *views[8:]]
    assert shown_views(views, Path("a.mp4"), 100) == shown_views(views, Path("a.gif"), 50) == views


def images_in_memory() -> int:
    gc.collect()
    return sum(issubclass(type(value), Image.Image) for value in gc.get_objects())


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
@pytest.mark.parametrize("transparent", [True, False])
def test_animations_are_encoded_as_frames_come(suffix: str, transparent: bool, tmp_path: Path) -> None:
    """They loop, show every frame, also equal ones, and keep no frame in memory."""
    generator = np.random.default_rng(0)
    colours = generator.integers(0, 255, (6, 4, 4, 4), dtype=np.uint8)
    shots = colours.repeat(16, 1).repeat(16, 2)
    shots[..., 3] = 255 * (shots[..., 3] > 127)
    shots[3] = shots[2]
    shots[5] = shots[4]
    settings = VideoSettings(20, 100, None if transparent else (255, 255, 255))
    path = tmp_path / f"a{suffix}"
    with closing(FORMATS[suffix].sink(path, settings)) as sink:
        count = images_in_memory()
        for index, shot in enumerate(shots):
            sink.add(index, shot if transparent else shot[..., :3].copy())
        assert images_in_memory() <= count + 1
        sink.finish()
    with Image.open(path) as video:
        assert video.info["loop"] == 0
        begins = [0, *accumulate(delays(path))]  # webp holds equal frames once
        assert begins[-1] == 300
        for index, shot in enumerate(shots):
            video.seek(bisect(begins, 50 * index) - 1)
            decoded = np.asarray(video.convert("RGBA")).astype(int)
            solid = shot[..., 3] > 127 if transparent else np.ones(shot.shape[:2], bool)
            assert np.array_equal(decoded[..., 3] > 127, solid)
            assert np.abs(decoded - shot)[..., :3][solid].mean() < 12


@pytest.mark.parametrize("suffix", [".mp4", ".webp", ".gif"])
def test_less_quality_is_a_smaller_file(suffix: str, model: Model, tmp_path: Path) -> None:
    for quality in (10, 95):
        list(turn(model, tmp_path / f"{quality}{suffix}", 3, size=(64, 64), quality=quality))
    assert (tmp_path / f"10{suffix}").stat().st_size < (tmp_path / f"95{suffix}").stat().st_size


def test_an_mp4_has_the_colours_of_its_frames_and_says_how(model: Model, tmp_path: Path) -> None:
    """Players that are told nothing take small videos for BT.601, and large ones for BT.709."""
    for name in ("a.mp4", "a.frames"):
        list(turn(model, tmp_path / name, 2, size=(64, 64), quality=100, background=(30, 160, 90)))
    with av.open(str(tmp_path / "a.mp4")) as video:
        coded = video.streams.video[0].codec_context
        assert (coded.colorspace, coded.color_range, coded.color_primaries, coded.color_trc) == (1, 1, 1, 1)
        decoded = next(video.decode(video=0)).to_ndarray(format="rgb24").astype(int)
    with Image.open(tmp_path / "a.frames/00000.png") as image:
        assert abs(decoded - np.asarray(image)).mean() < 3
    head = (tmp_path / "a.mp4").read_bytes()
    assert head.index(b"moov") < head.index(b"mdat")


def test_wrong_names_sizes_and_settings_are_refused(model: Model, tmp_path: Path) -> None:
    for path, message in ((tmp_path / "turn.avi", "mp4"), (tmp_path / "gone" / "turn.mp4", "cannot write")):
        with pytest.raises(ValueError, match=message):
            next(turn(model, path))
    with pytest.raises(ValueError, match="transparent"):
        next(turn(model, tmp_path / "t.mp4", background=None))
    with pytest.raises(ValueError, match="at least 2 px"):
        next(turn(model, tmp_path / "t.mp4", size=(1, 1)))
    with pytest.raises(ValueError, match="quality"):
        VideoSettings(quality=0)
