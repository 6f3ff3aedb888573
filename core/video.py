"""Turntable videos: one orbit of an object as mp4 (H.264), gif or webp, by the file's name."""

from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Protocol

import av
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.camera import Camera
from core.codes import Codes
from core.files import whole_file
from core.frames import RenderJob, RenderSettings
from core.frames import frames as rendered
from core.model import Model

FORMATS = (".mp4", ".gif", ".webp")
_RATE = 24
"""frames per second: an orbit of 72 frames takes three seconds"""
_FULL = RenderSettings(stages=(1,))


class _Sink(Protocol):
    def add(self, image: UInt8[np.ndarray, "height width 3"]) -> None: ...

    def finish(self) -> None: ...

    def close(self) -> None: ...


def turntable(
    model: Model, codes: Codes, camera: Camera, path: Path, frames: int = 72, size: int = 256
) -> Generator[int, None, None]:
    """Write one turn around the object, from the camera's azimuth and at its elevation and distance.

    Yields the number of frames written so far, many times a frame so that a worker can do other things between, and
    nothing is left at ``path`` unless all of them were: to cancel, close the generator.

    Args:
        size: px, width and height.

    Raises ``ValueError`` for a name of another format, a size or a count that no video has, or a path that cannot
    be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path.name}: a video is called {', '.join(FORMATS)}")
    if frames < 1 or not 2 <= size <= 4096:
        raise ValueError(f"a turntable needs at least 1 frame and 2 to 4096 px, got {frames} and {size}")
    with whole_file(path) as partial:
        sink: _Sink = _Mp4(partial, size) if path.suffix.lower() == ".mp4" else _Pillow(partial)
        with closing(sink):
            view = camera.resized(size, size)
            for index in range(frames):
                turned = replace(view, azimuth=camera.azimuth + 2 * np.pi * index / frames)
                for frame in rendered(model, RenderJob(codes, turned, _FULL)):
                    if frame:
                        sink.add(frame.image)
                    yield index + (frame is not None)
            sink.finish()


class _Mp4:
    def __init__(self, path: Path, size: int) -> None:
        self._container = av.open(str(path), "w")
        self._stream = self._container.add_stream("libx264", rate=_RATE, options={"crf": "18"})
        # H.264 with 4:2:0 colour has even sizes only.
        self._stream.width = self._stream.height = size - size % 2
        self._stream.pix_fmt = "yuv420p"
        self._stream.time_base = Fraction(1, _RATE)

    def add(self, image: UInt8[np.ndarray, "height width 3"]) -> None:
        even = np.ascontiguousarray(image[: self._stream.height, : self._stream.width])
        self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))

    def finish(self) -> None:
        self._container.mux(self._stream.encode())

    def close(self) -> None:
        self._container.close()


class _Pillow:
    def __init__(self, path: Path) -> None:
        self._path, self._images = path, list[Image.Image]()

    def add(self, image: UInt8[np.ndarray, "height width 3"]) -> None:
        self._images.append(Image.fromarray(image))

    def finish(self) -> None:
        first, *rest = self._images
        # gif counts in hundredths of a second.
        first.save(self._path, save_all=True, append_images=rest, duration=round(1000 / _RATE, -1), loop=0)

    def close(self) -> None:
        self._images.clear()
