"""Videos of a walk around an object, as photos: the sharpest frame of each of several even steps of time.

A first pass reads the times of all packets, because headers give no duration (browsers' recordings) or a wrong one
(truncated files). The second pass decodes what the steps need, from the nearest keyframe on.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from PIL import Image

from core.photos.colour_encoding import BT2020, HDR, Encoding, decoded
from core.photos.decode import WORKING_SIDE
from core.photos.sharpness import measure_sharpness
from core.runtime.reading import reading
from core.runtime.threads import thread_count

if TYPE_CHECKING:
    import av

VIDEO_SUFFIXES = ".mp4", ".mov", ".webm"
FRAMES = 8  # usual number of frames
MAX_FRAMES = 100  # 4 MB each
_FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm"  # FFmpeg's playlists would open other files
_MAX_PIXELS = 36_000_000  # of a frame, 8K; a decoder holds up to 20 frames
_MAX_SECONDS = 1200.0  # of a video
_MAX_PACKETS = 150_000  # of a video: the longest one at 120 frames a second
_MAX_THREADS = 4  # decoding at once; each holds a frame
_WINDOW = 2.0  # s around the middle of a step in which frames are compared; the camera moves little meanwhile
_COMPARED_SIDE = 512  # px: longer side at which sharpness is measured
_MIDDLE = 0.6  # fraction of a frame's sides within which sharpness is measured: the object, less of the background
_REPORT_EVERY = 512  # packets of the first pass between two values of the stream
_TURNS = (None, Image.Transpose.ROTATE_90, Image.Transpose.ROTATE_180, Image.Transpose.ROTATE_270)

# Numbers of FFmpeg
_UNSPECIFIED, _BT709, _BT601 = 2, 1, 5


class ClipFrame(NamedTuple):
    """A frame of a video."""

    image: Image.Image  # RGBA, upright, sRGB, the longer side at most WORKING_SIDE
    seconds: float  # since the first frame


def is_clip(path: Path | str) -> bool:
    """True for the name of a video that :func:`read_clip` reads."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_clip(path: Path, count: int = FRAMES) -> Generator[float, None, tuple[ClipFrame, ...]]:
    """Read the sharpest frame of each of ``count`` even steps of time; yield the finished fraction, 0..1.

    Steps without a frame, as in broken files and slide shows, give none. HDR is tone-mapped: light above the reference
    white is clipped. At most one frame of each step is held.

    Raises ``ValueError`` naming the file if it has no frame, or exceeds the limits of size and duration.
    """
    if not 1 <= count <= MAX_FRAMES:
        raise ValueError(f"a video gives 1 to {MAX_FRAMES} frames, not {count}")
    stream = _read(path, count)
    while True:
        with reading(path, "a video"):  # not around the yield: it would be on for whoever asks
            try:
                fraction = next(stream)
            except StopIteration as done:
                return done.value
        yield fraction


def _read(path: Path, count: int) -> Generator[float, None, tuple[ClipFrame, ...]]:
    with closing(_Video(path)) as video:
        packets = yield from _list_packets(video)
    plan = _Plan(packets, count)
    candidates = dict[int, tuple[float, ClipFrame]]()  # by step: sharpness and frame
    with closing(_Video(path)) as video:
        for fraction, frame in video.decode(plan.needed()):
            if frame is not None and (step := plan.step_of(float(frame.time))) is not None:
                sharpness = _sharpness(frame)
                if step not in candidates or sharpness > candidates[step][0]:
                    candidates[step] = sharpness, ClipFrame(_to_image(frame), float(frame.time) - plan.first)
            yield fraction
    if not candidates:
        raise ValueError("no frame of this video can be decoded")
    return tuple(candidates[step][1] for step in sorted(candidates))


class _Packet(NamedTuple):
    seconds: float
    is_keyframe: bool


def _list_packets(video: "_Video") -> Generator[float, None, list[_Packet]]:
    """List the video's packets in the order of the file. Raises ``ValueError`` for none, or too many."""
    packets = list[_Packet]()
    for packet in video.packets():
        packets.append(_Packet(_seconds(packet), packet.is_keyframe))
        if len(packets) > _MAX_PACKETS:
            raise ValueError(f"the video has more than {_MAX_PACKETS} frames: cut it to the walk around the object")
        if len(packets) % _REPORT_EVERY == 0:
            yield 0.0
    if not packets:
        raise ValueError("the video has no frames")
    times = [packet.seconds for packet in packets]
    if max(times) - min(times) > _MAX_SECONDS:
        raise ValueError(
            f"the video is longer than {_MAX_SECONDS / 60:.0f} minutes: cut it to the walk around the object"
        )
    return packets


class _Plan:
    """Frames to compare, and packets to decode for them."""

    def __init__(self, packets: Sequence[_Packet], count: int) -> None:
        times = sorted(packet.seconds for packet in packets)
        self._packets = packets  # in the order of the file
        self._count = count  # steps of time
        self.first = times[0]  # time of the first frame in seconds
        self._length = (times[-1] - times[0]) / count  # of a step in seconds; 0 for a single frame
        self._spacing = max((later - earlier for earlier, later in pairwise(times)), default=0.0)  # longest, seconds

    def step_of(self, seconds: float) -> int | None:
        """Return the step of a frame; None for a frame that is not compared."""
        if not self._length:
            return 0
        position = (seconds - self.first) / self._length
        step = min(self._count - 1, int(position))
        return step if abs(position - step - 0.5) * self._length <= max(_WINDOW, self._spacing) / 2 else None

    def needed(self) -> list[bool]:
        """True for each packet that is compared, or from which a compared one is decoded."""
        needed = []
        follows = False  # a needed packet follows, before the next keyframe
        for packet in reversed(self._packets):
            follows = follows or self.step_of(packet.seconds) is not None
            needed.append(follows)
            follows = follows and not packet.is_keyframe
        return needed[::-1]


class _Video:
    """An open video file. Raises ``ValueError`` if it has no video, or one that is too large."""

    def __init__(self, path: Path) -> None:
        import av  # imported late: few commands read videos

        self._av = av
        self._file = path.open("rb")
        try:
            self._container = av.open(self._file, "r", options={"format_whitelist": _FORMATS})
            self._stream = self._video_stream()
        except (av.FFmpegError, OSError):  # the latter by an empty file
            self._file.close()
            raise ValueError("this is no video (mp4, mov, webm), or most of it is missing") from None
        except ValueError:
            self._file.close()
            raise
        self._codec = self._stream.codec_context
        self._codec.thread_type = "AUTO"
        self._codec.thread_count = min(_MAX_THREADS, thread_count())
        self._codec.options = {"max_pixels": str(_MAX_PIXELS)}  # a frame may be larger than the header says

    def _video_stream(self) -> Any:
        attached = self._av.stream.Disposition.attached_pic  # the cover of a sound
        streams = [stream for stream in self._container.streams.video if not stream.disposition & attached]
        if not streams:
            raise ValueError("there is sound, but no video" if self._container.streams.audio else "there is no video")
        width = streams[0].codec_context.width
        height = streams[0].codec_context.height
        if width * height > _MAX_PIXELS:
            raise ValueError(f"the video is too large ({width}x{height} px); make it smaller first")
        return streams[0]

    def packets(self) -> Iterator["av.Packet"]:
        """Yield the packets of frames; an error of the file ends them."""
        try:
            for packet in self._container.demux(self._stream):
                if packet.size and (packet.pts is not None or packet.dts is not None):
                    yield packet
        except self._av.FFmpegError:
            return

    def decode(self, needed: Sequence[bool]) -> Iterator[tuple[float, "av.VideoFrame | None"]]:
        """Yield the finished fraction with each frame of the needed packets, or None."""
        total = max(1, sum(needed))
        done = 0
        was_needed = False
        for packet, is_needed in zip(self.packets(), needed, strict=False):
            if was_needed and not is_needed:
                yield from ((done / total, frame) for frame in self._drain())
            if is_needed:
                done += 1
                yield from ((done / total, frame) for frame in self._decode(packet))
                yield done / total, None
            was_needed = is_needed
        yield from ((1.0, frame) for frame in self._drain())

    def _drain(self) -> list["av.VideoFrame"]:
        """Return the frames that the decoder still holds, and prepare it for another keyframe."""
        frames = self._decode(None)
        self._codec.flush_buffers()
        return frames

    def _decode(self, packet: "av.Packet | None") -> list["av.VideoFrame"]:
        """Return the undamaged frames of a packet; none if it is damaged."""
        if packet is not None and packet.is_corrupt:
            return []
        try:
            frames = self._codec.decode(packet)
        except self._av.FFmpegError:
            return []
        frames = [frame for frame in frames if frame.pts is not None and not frame.is_corrupt]
        for frame in frames:
            frame.time_base = self._stream.time_base  # a drained decoder does not know it
        return frames

    def close(self) -> None:
        """Close the file."""
        self._container.close()
        self._file.close()


def _seconds(packet: "av.Packet") -> float:
    timestamp = packet.dts if packet.pts is None else packet.pts
    return float((timestamp or 0) * packet.time_base)


# Frames


def _sharpness(frame: "av.VideoFrame") -> float:
    """Measure the sharpness of a frame's middle."""
    width, height = _fitted_size(frame.width, frame.height, _COMPARED_SIDE)
    grey = frame.reformat(width, height, "gray", interpolation="AREA").to_ndarray()
    rows, columns = (slice(round((1 - _MIDDLE) / 2 * side), round((1 + _MIDDLE) / 2 * side)) for side in grey.shape)
    return measure_sharpness(grey[rows, columns].astype(np.float32) / 255)


def _to_image(frame: "av.VideoFrame") -> Image.Image:
    """Return a frame as an upright sRGB image of moderate size."""
    size = _fitted_size(frame.width, frame.height, WORKING_SIDE)
    # Players take unlabelled videos for BT.709 if they are large.
    unlabelled = _BT709 if frame.height >= 720 else _BT601
    matrix = unlabelled if frame.colorspace == _UNSPECIFIED else frame.colorspace
    pixels = frame.reformat(*size, "rgb24", src_colorspace=matrix, interpolation="AREA").to_ndarray()
    image = Image.fromarray(pixels).convert("RGBA")
    if frame.color_trc in HDR:
        image = decoded(image, Encoding(BT2020, frame.color_trc))
    turn = _TURNS[round(frame.rotation / 90) % 4]
    return image if turn is None else image.transpose(turn)


def _fitted_size(width: int, height: int, side: int) -> tuple[int, int]:
    """Return a size of the same proportions whose longer side is at most ``side``."""
    scale = min(1.0, side / max(width, height))
    return max(1, round(scale * width)), max(1, round(scale * height))
