"""Videos are written here with PyAV: a bright square moves over a pattern, some frames blurred."""

import struct
import weakref
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFilter

from core.photos import clip
from core.photos.clip import ClipFrame, is_clip, read_clip
from core.photos.decode import WORKING_SIDE
from core.streams import run_to_end

SIZE = (96, 64)
SECOND = 1000  # ticks of a written video
_HLG, _BT2020, _BT2020_MATRIX = 18, 9, 9  # numbers of H.264


def scene(position: float, size: tuple[int, int] = SIZE) -> Image.Image:
    """A pattern of fine lines with a white square at a fraction of the width."""
    image = Image.new("RGB", size, (40, 60, 90))
    draw = ImageDraw.Draw(image)
    for x in range(0, size[0], 6):
        draw.line((x, 0, x, size[1]), (150, 120, 90), 2)
    left = round(position * (size[0] - 16))
    draw.rectangle((left, 8, left + 15, 23), "white")
    return image


def blurred(image: Image.Image) -> Image.Image:
    return image.filter(ImageFilter.GaussianBlur(3))


def square_position(frame: ClipFrame) -> float:
    """Where the white square of a scene is, as in :func:`scene`."""
    columns = np.asarray(frame.image.convert("L"))[10:22].mean(0)
    return float(np.flatnonzero(columns > 200).mean() - 7.5) / (SIZE[0] - 16)


def write_clip(
    path: Path,
    images: Iterable[Image.Image],
    times: Sequence[float] | None = None,
    codec: str = "libx264",
    keyframes: int = 12,
    transfer: int = 0,
) -> Path:
    """Write images as a video, 24 a second unless times are given."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24)
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, SECOND)
        stream.codec_context.gop_size = keyframes
        if transfer:
            stream.codec_context.color_trc = transfer
            stream.codec_context.color_primaries = _BT2020
            stream.codec_context.colorspace = _BT2020_MATRIX
        if codec == "libx264":
            stream.options = {"crf": "8"}
        for number, image in enumerate(images):
            if not stream.codec_context.is_open:
                stream.width, stream.height = image.size
            frame = av.VideoFrame.from_image(image).reformat(format="yuv420p")
            if transfer:
                frame.color_trc = transfer
                frame.color_primaries = _BT2020
                frame.colorspace = _BT2020_MATRIX
            frame.pts = round(SECOND * (times[number] if times else number / 24))
            frame.time_base = Fraction(1, SECOND)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def frames_of(path: Path, count: int = 8) -> tuple[ClipFrame, ...]:
    return run_to_end(read_clip(path, count))


def walk(count: int = 48) -> list[Image.Image]:
    return [scene(number / (count - 1)) for number in range(count)]


def test_suffixes_of_videos_are_recognised_in_any_case() -> None:
    assert [is_clip(name) for name in ("a.mp4", "A.MOV", Path("b.webm"), "c.png", "mp4")] == [True] * 3 + [False] * 2


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "libx264"), ("a.mov", "libx264"), ("a.webm", "libvpx-vp9")])
def test_the_sharp_frame_of_each_step_is_chosen(name: str, codec: str, tmp_path: Path) -> None:
    sharp = (3, 12, 21, 30)  # one of each quarter of 36 frames
    images = [image if number in sharp else blurred(image) for number, image in enumerate(walk(36))]
    frames = frames_of(write_clip(tmp_path / name, images, codec=codec), 4)
    assert [round(24 * frame.seconds) for frame in frames] == list(sharp)
    assert [square_position(frame) for frame in frames] == pytest.approx([number / 35 for number in sharp], abs=0.02)
    assert all(frame.image.mode == "RGBA" and frame.image.size == SIZE for frame in frames)


def test_progress_grows_to_1(tmp_path: Path) -> None:
    fractions: list[float] = []
    run_to_end(read_clip(write_clip(tmp_path / "a.mp4", walk(24)), 3), fractions.append)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1


def turned(content: bytes, matrix: tuple[int, int, int, int]) -> bytes:
    """Return an mp4 with another 2x2 matrix in its track header."""
    first = content.index(b"tkhd") + 4 + 40
    a, b, c, d = (number << 16 for number in matrix)
    return content[:first] + struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30) + content[first + 36 :]


@pytest.mark.parametrize(
    ("matrix", "turn"),
    [
        ((0, 1, -1, 0), Image.Transpose.ROTATE_270),  # a phone held upright
        ((-1, 0, 0, -1), Image.Transpose.ROTATE_180),
        ((0, -1, 1, 0), Image.Transpose.ROTATE_90),
    ],
)
def test_frames_are_turned_upright(matrix: tuple[int, int, int, int], turn: Image.Transpose, tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mp4", [scene(0.1)] * 3)
    path.write_bytes(turned(path.read_bytes(), matrix))
    (frame,) = frames_of(path, 1)
    expected = scene(0.1).transpose(turn)
    assert frame.image.size == expected.size
    assert np.abs(np.asarray(frame.image.convert("RGB"), float) - np.asarray(expected)).mean() < 6


def test_steps_are_even_in_time_at_a_variable_frame_rate(tmp_path: Path) -> None:
    times = [*np.linspace(0, 1, 30), *np.linspace(1.2, 4, 8)]  # most frames lie in the first quarter
    images = [scene(time / 4) for time in times]
    frames = frames_of(write_clip(tmp_path / "a.mp4", images, times), 4)
    assert [int(frame.seconds) for frame in frames[:3]] == [0, 1, 2]
    assert frames[3].seconds > 3
    assert [square_position(frame) for frame in frames] == pytest.approx([f.seconds / 4 for f in frames], abs=0.03)


def test_a_pause_leaves_its_steps_out(tmp_path: Path) -> None:
    times = [0, 0.1, 0.2, 5.8, 5.9, 6.0]
    assert len(frames_of(write_clip(tmp_path / "a.mp4", walk(6), times), 6)) == 2


def test_frames_of_a_truncated_file_are_used(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.webm", walk(48), codec="libvpx", keyframes=6)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 6 // 10])
    frames = frames_of(path, 4)
    assert 2 <= len(frames) <= 4
    assert frames[-1].seconds < 1.6
    assert [square_position(frame) for frame in frames] == pytest.approx(
        [f.seconds * 24 / 47 for f in frames], abs=0.03
    )


def test_damaged_packets_are_skipped(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mp4", walk(48), keyframes=6)
    content = bytearray(path.read_bytes())
    begin = content.index(b"mdat") + len(content) // 3
    content[begin : begin + 400] = b"\xff" * 400
    path.write_bytes(content)
    assert frames_of(path, 4)[-1].seconds > 1.4


def test_one_frame_is_a_clip(tmp_path: Path) -> None:
    (frame,) = frames_of(write_clip(tmp_path / "a.mp4", [scene(0.5)]))
    assert frame.seconds == 0
    assert square_position(frame) == pytest.approx(0.5, abs=0.02)


def write_sound(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((2, 1024), np.float32), format="fltp", layout="stereo")
        frame.sample_rate = 44100
        frame.pts = 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def test_files_without_frames_give_one_line_that_names_them(tmp_path: Path) -> None:
    cut = write_clip(tmp_path / "cut.mp4", walk(12))
    cut.write_bytes(cut.read_bytes()[:600])  # the index at the end is missing
    empty = tmp_path / "empty.mov"
    empty.touch()
    text = tmp_path / "text.webm"
    text.write_text("#EXTM3U\nother.mp4\n")
    expected = {
        write_sound(tmp_path / "sound.mp4"): "sound, but no video",
        cut: "no video.*missing",
        empty: "no video",
        text: "no video",
        tmp_path / "gone.mp4": "no such video",
        tmp_path: "is a folder",
    }
    for path, message in expected.items():
        with pytest.raises(ValueError, match=message) as raised:
            frames_of(path)
        assert path.name in str(raised.value)
        assert "\n" not in str(raised.value)


def test_playlists_do_not_open_other_files(tmp_path: Path) -> None:
    write_clip(tmp_path / "other.mp4", walk(4))
    playlist = tmp_path / "list.mp4"
    playlist.write_text(f"ffconcat version 1.0\nfile {tmp_path}/other.mp4\n")
    with pytest.raises(ValueError, match=r"list\.mp4: this is no video"):
        frames_of(playlist)


@pytest.mark.parametrize(
    ("limit", "value", "message"),
    [
        ("_MAX_PIXELS", 96 * 64 - 1, "too large .96x64 px"),
        ("_MAX_SECONDS", 0.4, "longer than 0 minutes"),
        ("_MAX_PACKETS", 11, "more than 11 frames"),
    ],
)
def test_videos_beyond_the_limits_are_refused(
    limit: str, value: float, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clip, limit, value)
    with pytest.raises(ValueError, match=message):
        frames_of(write_clip(tmp_path / "a.mp4", walk(12)))


def test_a_count_out_of_range_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1 to 100 frames, not 0"):
        frames_of(tmp_path / "a.mp4", 0)


def test_one_image_of_each_step_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames become sharper and sharper, so that each replaces the last one."""
    path = write_clip(tmp_path / "a.mp4", [image.resize(SIZE) for image in fading(30)])
    convert = clip._to_image
    images: list[weakref.ref[Image.Image]] = []
    peak = 0

    def track(frame: av.VideoFrame) -> Image.Image:
        nonlocal peak
        image = convert(frame)
        images.append(weakref.ref(image))
        peak = max(peak, sum(reference() is not None for reference in images))
        return image

    monkeypatch.setattr(clip, "_to_image", track)
    assert len(frames_of(path, 3)) == 3
    assert len(images) > 12
    assert peak <= 4  # one of each step, and the new one


def fading(count: int) -> list[Image.Image]:
    """Images of more and more contrast."""
    return [Image.blend(Image.new("RGB", SIZE, (90, 90, 90)), scene(0.3), number / count) for number in range(count)]


def test_a_long_clip_is_decoded_around_the_middles_of_steps_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_clip(tmp_path / "a.mp4", walk(240))  # 10 s, a keyframe each half second
    monkeypatch.setattr(clip, "_WINDOW", 0.5)
    decoded: list[float] = []
    measure = clip._sharpness
    monkeypatch.setattr(clip, "_sharpness", lambda frame: decoded.append(frame.time) or measure(frame))
    frames = frames_of(path, 4)
    assert len(decoded) <= 4 * 13
    assert [frame.seconds for frame in frames] == pytest.approx([1.25, 3.75, 6.25, 8.75], abs=0.3)
    assert [square_position(frame) for frame in frames] == pytest.approx(
        [f.seconds * 24 / 239 for f in frames], abs=0.02
    )


def test_large_frames_are_reduced(tmp_path: Path) -> None:
    (frame,) = frames_of(write_clip(tmp_path / "a.mp4", [scene(0.2, (2 * WORKING_SIDE, 512))]), 1)
    assert frame.image.size == (WORKING_SIDE, 256)


def test_hdr_is_shown_in_the_colours_of_srgb(tmp_path: Path) -> None:
    """Hybrid log-gamma: a signal of 75 % is white, of 38 % an eighth of its light."""
    levels = Image.fromarray(np.repeat(np.repeat(np.uint8([[97], [191], [255]])[..., None], 3, 2).repeat(32, 0), 96, 1))
    (frame,) = frames_of(write_clip(tmp_path / "a.mp4", [levels], transfer=_HLG), 1)
    grey = np.asarray(frame.image.convert("L"), float)
    dark, white, brightest = (grey[row].mean() for row in (16, 48, 80))
    assert dark == pytest.approx(101, abs=12)
    assert white > 246
    assert brightest == 255
