"""Thumbnails: small renders of any object from any camera, queued and cached."""

import hashlib
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from core.detail.progressive import Frame, RenderJob, RenderSettings
from core.geometry.camera import Camera, Factors
from core.geometry.pixels import to_bytes
from core.models.model import Instance
from core.models.photo_detail import PhotoDetail
from viewer.services.jobs import TILES_WEIGHT, Jobs
from viewer.services.worker import Job
from viewer.store.pictures import Pixels
from viewer.values import orbit

SIZE = 64  # px, side of most thumbnails
_SAMPLES = 40  # intervals along the longest side of the scene's box
_MAX_KEPT = 1000  # cached thumbnails; one of 64 px takes 28 kB
_STORED = 300  # thumbnails stored for the next launch
_BATCH = 6  # thumbnails rendered before the requests are read again


class _Key(NamedTuple):
    """The inputs of a thumbnail; objects by their numbers, so that equal ones share a thumbnail."""

    model: str
    shape: tuple[Hashable, ...]
    texture: tuple[Hashable, ...]
    camera: Camera
    samples: int
    detail: PhotoDetail | None
    proportions: Factors | None


def _key(instance: Instance, camera: Camera, samples: int) -> _Key:
    codes = instance.codes
    numbers = codes.shape_key, codes.texture_key
    return _Key(instance.fingerprint, *numbers, camera, samples, codes.detail, codes.proportions)


@lru_cache(maxsize=_MAX_KEPT)
def _digest(key: _Key) -> str:
    """Return a hash of all inputs, for the names of stored images."""
    text = f"{key.model} {key.camera} {key.samples} {key.shape} {key.texture}".encode()
    text += f" {key.proportions}".encode() if key.proportions else b""
    detail = _detail_digest(key.detail) if key.detail else b""
    return hashlib.blake2b(text + detail, digest_size=16).hexdigest()


@lru_cache(maxsize=256)
def _detail_digest(detail: PhotoDetail) -> bytes:
    views = "".join(f"{hashlib.blake2b(view.image).hexdigest()} {view.camera} {view.erased}" for view in detail.views)
    fitted = f"{detail.fitted.shape_key} {detail.fitted.texture_key}"
    text = f"{views} {fitted} {detail.strength} {detail.other_side}"
    return hashlib.blake2b(text.encode(), digest_size=16).digest()


def digest(instance: Instance, camera: Camera) -> str:
    """Return a hash of an image's inputs, for the names of stored images."""
    return _digest(_key(instance, camera, 0))


def frame_of(pixels: Pixels, samples: int = 0, stages: int = 1) -> Frame:
    """Return stored pixels as a frame without depth, the first of ``stages``."""
    opacity = pixels[..., 3] / np.float32(255)
    return Frame(pixels[..., :3], _no_depth(opacity), opacity, 0, stages, samples, 0.0)


def pixels_of(frame: Frame) -> Pixels:
    """Return a frame's pixels for storage."""
    return np.dstack((frame.image, to_bytes(frame.opacity)))


def _no_depth(opacity: Float32[np.ndarray, "height width"]) -> Float32[np.ndarray, "height width"]:
    """Return a depth of 0 that takes no memory, as thumbnails need none."""
    return np.broadcast_to(np.float32(0), opacity.shape)


class Thumbnails:
    """Renders the thumbnails that panels request in every frame; a request that is not repeated is dropped."""

    def __init__(self, jobs: Jobs, stored: Mapping[str, Pixels] | None = None) -> None:
        """Begin with images of the last launch, by digest; larger ones are no thumbnails."""
        self._jobs = jobs
        self._stored = {digest: pixels for digest, pixels in (stored or {}).items() if len(pixels) <= SIZE}
        self._frames: dict[_Key, Frame] = {}  # cached thumbnails, the least recently used first
        self._queue: dict[_Key, Instance] = {}  # requests of this frame
        self.rendered = 0  # thumbnails so far
        self._failed: set[_Key] = set()  # keys whose rendering failed, not tried again

    def of_object(self, instance: Instance, size: int = SIZE, samples: int = _SAMPLES) -> Frame | None:
        """Return the thumbnail of an object from its model's first view, as :meth:`get`."""
        camera = orbit.home(instance.model).resized(size, size)
        return self._get(_key(instance, camera, samples), instance)

    def get(self, instance: Instance, camera: Camera, soon: bool = False) -> Frame | None:
        """Return the thumbnail at the camera's size; None until it is rendered, first if ``soon``. Call each frame."""
        return self._get(_key(instance, camera, _SAMPLES), instance, soon)

    def _get(self, key: _Key, instance: Instance, soon: bool = False) -> Frame | None:
        if key not in self._frames and (pixels := self._stored.get(_digest(key))) is not None:
            self._frames[key] = frame_of(pixels, key.samples)
        if key in self._frames:
            self._frames[key] = self._frames.pop(key)
            return self._frames[key]
        request = {key: instance}
        self._queue = request | self._queue if soon else self._queue | request
        return None

    def newest(self) -> Callable[[], dict[str, Pixels]]:
        """Return a function, on any thread, that makes the newest images to store, by digest."""
        frames = [*self._frames.items()][-_STORED:]
        return lambda: {_digest(key): pixels_of(frame) for key, frame in frames}

    def tick(self) -> None:
        """Begin to render a batch of the requests since the last call; call once a frame."""
        if self._jobs.busy("thumbnails"):
            self._queue = {}
            return
        missing = [key for key in self._queue if key not in self._frames and key not in self._failed]
        batch = [(key, self._queue[key]) for key in missing[:_BATCH]]
        self._queue = {}
        if not batch:
            return

        def ended(error: Exception | None) -> None:
            if error:
                self._failed.update(key for key, _ in batch if key not in self._frames)
                self._jobs.messages.report("Cannot render the thumbnails", error)

        self._jobs.submit(Job("thumbnails", lambda: self._render(batch), self._keep, ended, weight=TILES_WEIGHT))

    def _render(self, batch: list[tuple[_Key, Instance]]) -> Iterator[tuple[_Key, Frame] | None]:
        for key, instance in batch:
            job = RenderJob(instance, key.camera, RenderSettings(key.samples, divisors=(1,)))
            for frame in self._jobs.backend.frames(job):
                yield (key, frame) if frame else None

    def _keep(self, rendered: tuple[_Key, Frame]) -> None:
        key, frame = rendered
        self.rendered += 1
        self._frames[key] = replace(frame, depth=_no_depth(frame.opacity), evaluations=None)
        while len(self._frames) > _MAX_KEPT:
            del self._frames[next(iter(self._frames))]
