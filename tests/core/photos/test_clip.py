"""Videos are written here with PyAV: a bright square moves over a pattern, some frames blurred."""

import gc
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
