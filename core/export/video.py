"""Videos of an object as mp4 (H.264), gif, webp or a folder of png images, by the name's ending."""

import struct
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageChops
from PIL.GifImagePlugin import getdata

from core.export.dimensions import draw_dimensions
from core.export.films import View
from core.export.video_frames import render_frames
from core.gl.background import Background, Rgb
from core.runtime.files import atomic_file, atomic_folder
from core.runtime.modes import isolated

WHITE: Rgb = (255, 255, 255)
_BT709, _LIMITED_RANGE = 1, 1  # numbers of H.264 and FFmpeg
_ENDLESS = b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"  # of a gif: it plays again and again
_HELD = 2  # s, for which a last frame with dimensions stays
_WAITING = 4  # frames queued for the encoder, at most


@dataclass(frozen=True)
class VideoSettings:
    """Options of a video. Raises ``ValueError`` for values out of range."""

    rate: int = 24  # frames per second
    quality: int = 85  # 1 to 100, of mp4 and webp; for gif, the fraction of its 256 colours
    background: Background | None = WHITE  # None is transparent
    exact: bool = False  # every frame by the network; else the faster way
    shadow: bool = False  # of the object on the ground
    unit: str | None = None  # of dimensions on the last frame, which then stays (:data:`core.export.dimensions.UNITS`)

    def __post_init__(self) -> None:
        if not 1 <= self.rate <= 100 or not 1 <= self.quality <= 100:
            raise ValueError(f"a video has 1 to 100 frames a second, quality 1 to 100; got {self.rate}, {self.quality}")


@isolated
def write_video(views: Sequence[View], path: Path, settings: VideoSettings | None = None) -> Generator[int, None, None]:
    """Render and write views in order, as large as their cameras.

    Where a format shows fewer frames a second, others are left out (:func:`shown_views`), and the duration stays.

    Yields the number of finished frames, many times a frame so that a worker can interleave other tasks. The file
    appears only when it is complete: to cancel, close the generator. Another thread encodes.

    Raises ``ValueError`` for an unknown format, sizes that differ or are below 2 px, a transparent background in a
    format without transparency, or a path that cannot be written.
    """
    settings = settings or VideoSettings()
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path.name}: a video must end in {', '.join(FORMATS)}")
    file_format = FORMATS[suffix]
    if settings.background is None and not file_format.transparent:
        able = ", ".join(name for name, kind in FORMATS.items() if kind.transparent)
        raise ValueError(f"{path.name}: only {able} can have a transparent background")
    sizes = {(view.camera.width, view.camera.height) for view in views}
    if len(sizes) != 1 or min(min(sizes)) < 2:
        raise ValueError(f"frames of a video have one size, of at least 2 px, got {sorted(sizes)}")
    views = shown_views(views, path, settings.rate)
    settings = replace(settings, rate=min(settings.rate, file_format.most_rate))
    atomic = atomic_folder if file_format.folder else atomic_file
    shadow = settings.shadow and file_format.shows_shadow(settings.background)
    frames = render_frames(views, settings.background, settings.exact, shadow)
    with atomic(path) as partial, closing(file_format.sink(partial, settings)) as sink, _Encoder(sink) as encoder:
        done = 0
        for image in frames:
            if image is not None:
                done += 1
                if settings.unit and done == len(views):
                    image = draw_dimensions(image, views[-1], settings.unit)
                    for _ in range(_HELD * settings.rate):
                        encoder.add(image)
                encoder.add(image)
            yield done
        encoder.finish()


def shown_views(views: Sequence[View], path: Path, rate: int) -> Sequence[View]:
    """Return the views, ``rate`` a second, that the format of a name shows at its own rate: one for each interval."""
    limit = FORMATS[path.suffix.lower()].most_rate
    if rate <= limit:
        return views
    return [view for index, view in enumerate(views) if index * limit // rate != (index - 1) * limit // rate]


class _Sink:
    def add(self, index: int, image: UInt8[np.ndarray, "height width channels"]) -> None:
        """Write a frame, counted from 0."""
        raise NotImplementedError

    def finish(self) -> None:
        """Write the remaining frames."""

    def close(self) -> None:
        """Release the file."""


class _Encoder:
    """A thread that passes images to a sink while the next ones are rendered; :meth:`finish` re-raises its errors."""

    def __init__(self, sink: _Sink) -> None:
        self._sink = sink
        self._thread = ThreadPoolExecutor(1, "encoder")
        self._count = 0
        self._waiting = deque[Future[None]]()

    def __enter__(self) -> "_Encoder":
        return self

    def __exit__(self, *error: object) -> None:
        self._thread.shutdown(cancel_futures=True)

    def add(self, image: UInt8[np.ndarray, "height width channels"]) -> None:
        """Pass a frame on; wait if too many are queued."""
        self._waiting.append(self._thread.submit(self._sink.add, self._count, image))
        self._count += 1
        if len(self._waiting) > _WAITING:
            self._waiting.popleft().result()

    def finish(self) -> None:
        """Wait for all frames, and complete the file."""
        while self._waiting:
            self._waiting.popleft().result()
        self._sink.finish()


class _Av(_Sink):
    """Writes frames by FFmpeg."""

    def __init__(self, path: Path, codec: str, rate: int, encoding: dict[str, str], **container: Any) -> None:
        import av  # imported late: the window only lists the formats

        self._av = av
        self._container = av.open(str(path), "w", **container)
        self._stream = self._container.add_stream(codec, rate=rate, options=encoding)

    def finish(self) -> None:
        self._container.mux(self._stream.encode())

    def close(self) -> None:
        self._container.close()


class _Mp4(_Av):
    def __init__(self, path: Path, settings: VideoSettings) -> None:
        # From nearly lossless (12) at 100 to blocks (40) at 1; 85 looks like the original.
        options = {"crf": f"{40 - 0.28 * settings.quality:.0f}"}
        # The index precedes the frames, so that a browser shows the first one before it has the last.
        super().__init__(path, "libx264", settings.rate, options, options={"movflags": "+faststart"})
        self._stream.pix_fmt = "yuv420p"
        self._stream.time_base = Fraction(1, settings.rate)
        self._label(self._stream.codec_context)

    def add(self, index: int, image: UInt8[np.ndarray, "height width channels"]) -> None:
        if not index:  # H.264 with 4:2:0 colour needs even sizes
            self._stream.height, self._stream.width = (side - side % 2 for side in image.shape[:2])
        even = np.ascontiguousarray(image[: self._stream.height, : self._stream.width])
        frame = self._av.VideoFrame.from_ndarray(even, format="rgb24")
        converted = frame.reformat(format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED_RANGE)
        self._label(converted)
        self._container.mux(self._stream.encode(converted))

    @staticmethod
    def _label(coded: Any) -> None:
        """State the colour matrix of the conversion: players guess differently without it."""
        coded.colorspace = coded.color_primaries = coded.color_trc = _BT709
        coded.color_range = _LIMITED_RANGE


class _Gif(_Sink):
    """Writes each frame as it comes, with a palette of its own: the part that differs from the frame before it."""

    def __init__(self, path: Path, settings: VideoSettings) -> None:
        self._file = path.open("wb")
        self._settings = settings
        self._previous: Image.Image | None = None

    def add(self, index: int, image: UInt8[np.ndarray, "height width channels"]) -> None:
        if not index:
            self._file.write(b"GIF89a" + struct.pack("<HHBBB", image.shape[1], image.shape[0], 0, 0, 0) + _ENDLESS)
        frame = self._reduced(Image.fromarray(image))
        box = self._changed(frame)
        duration = 10 * (self._centiseconds(index + 1) - self._centiseconds(index))
        options = {"transparency": 255, "disposal": 2} if self._settings.background is None else {}
        cropped = frame.crop(box)
        self._file.writelines(getdata(cropped, box[:2], duration=duration, include_color_table=True, **options))
        self._previous = frame

    def _reduced(self, frame: Image.Image) -> Image.Image:
        """Reduce a frame to its palette; index 255 marks transparent pixels, as gif has no partial opacity."""
        colours = max(8, round(2.55 * self._settings.quality))
        if self._settings.background is not None:
            return frame.quantize(colours)
        reduced = frame.convert("RGB").quantize(min(255, colours))
        reduced.paste(255, mask=frame.getchannel("A").point(lambda opacity: 255 * (opacity < 128)))
        return reduced

    def _changed(self, frame: Image.Image) -> tuple[int, int, int, int]:
        """Return the box to write: that of changes, or with a transparent background that of the object."""
        if self._settings.background is None:
            box = frame.point(lambda index: index != 255, "L").getbbox()
        elif self._previous is None:
            return (0, 0, *frame.size)
        else:
            box = ImageChops.difference(frame.convert("RGB"), self._previous.convert("RGB")).getbbox()
        return box or (0, 0, 1, 1)

    def _centiseconds(self, index: int) -> int:
        """Return when a frame begins."""
        return round(100 * index / self._settings.rate)

    def finish(self) -> None:
        self._file.write(b";")

    def close(self) -> None:
        self._file.close()


class _Webp(_Av):
    def __init__(self, path: Path, settings: VideoSettings) -> None:
        options = {"quality": str(settings.quality), "compression_level": "0"}  # higher levels take much longer
        container = {"format": "webp", "options": {"loop": "0"}}
        super().__init__(path, "libwebp_anim", settings.rate, options, **container)
        self._stream.pix_fmt = "bgra"
        self._stream.codec_context.time_base = Fraction(1, 1000)
        self._rate = settings.rate

    def add(self, index: int, image: UInt8[np.ndarray, "height width channels"]) -> None:
        if not index:
            self._stream.height, self._stream.width = image.shape[:2]
        frame = self._av.VideoFrame.from_ndarray(image, format="rgb24" if image.shape[2] == 3 else "rgba")
        frame = frame.reformat(format="bgra")
        frame.pts = round(1000 * index / self._rate)
        frame.time_base = Fraction(1, 1000)
        self._container.mux(self._stream.encode(frame))


class _Frames(_Sink):
    def __init__(self, path: Path, settings: VideoSettings) -> None:
        self._path = path

    def add(self, index: int, image: UInt8[np.ndarray, "height width channels"]) -> None:
        Image.fromarray(image).save(self._path / f"{index:05d}.png")


class VideoFormat(NamedTuple):
    """A video file format."""

    label: str
    sink: Callable[[Path, VideoSettings], _Sink]
    transparent: bool = True  # supports a transparent background
    folder: bool = False  # a folder of files instead of one
    translucent: bool = True  # supports partial opacity, which a soft shadow needs
    most_rate: int = 100  # frames per second that browsers show: they take delays up to 10 ms for 100 ms

    def shows_shadow(self, background: Background | None) -> bool:
        """True if frames on this background can have a soft shadow."""
        return self.translucent or background is not None


FORMATS = {
    ".mp4": VideoFormat("mp4", _Mp4, transparent=False),
    ".gif": VideoFormat("gif", _Gif, translucent=False, most_rate=50),
    ".webp": VideoFormat("webp", _Webp, most_rate=90),
    ".frames": VideoFormat("png frames", _Frames, folder=True),
}  # by the name's ending
