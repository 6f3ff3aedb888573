"""The history of a fit: photos, steps, and the selected step. All frozen."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from core.fitting.fit import FitStep, Hypothesis
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.photos.decode import IMAGE_SUFFIXES, upright_size
from core.photos.photo import Photo
from core.photos.segmentation import CutOut, Hints
from core.runtime.reading import optional, read_numbers
from viewer.values.printable import printable
from viewer.values.seen_cut_out import SeenCutOut

MAX_STEPS = 800  # steps kept; beyond, every other one is dropped


class PhotoSource(NamedTuple):
    """The origin of a photo: its file, and hints of a person."""

    path: Path
    pose: Path | None = None  # its SRN pose file, if the camera is known
    hints: Hints | None = None  # a person's hints to the object, if any

    @property
    def name(self) -> str:
        """Name of the file, printable."""
        return printable(self.path.name)


@dataclass(frozen=True, eq=False)
class FittedPhoto:
    """A photo that is fitted."""

    source: PhotoSource
    photo: Photo
    pixels: UInt8[np.ndarray, "height width 3"]
    seen: SeenCutOut | None = None  # None once it was saved

    @classmethod
    def of(cls, source: PhotoSource, photo: Photo, seen: SeenCutOut | None = None) -> FittedPhoto:
        """Build from a photo, converting its pixels to bytes."""
        return cls(source, photo, to_bytes(photo.pixels), seen)

    @property
    def digest(self) -> str:
        """Hash that identifies the photo."""
        return hashlib.sha256(self.pixels.tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class FitHistory:
    """The photos and steps of a fit so far."""

    sources: tuple[PhotoSource, ...] = ()
    photos: tuple[FittedPhoto, ...] = ()  # of the sources read so far
    steps: tuple[FitStep, ...] = ()
    photo_index: int = 0  # the selected photo
    model: str = ""  # fingerprint of the fitted model; empty until the first photo's category is known

    @property
    def name(self) -> str:
        """Name of the object: its first photo's."""
        return printable(self.sources[0].path.stem) if self.sources else ""

    @property
    def photo(self) -> FittedPhoto | None:
        """The selected photo, once it has been read."""
        return self.photos[self.photo_index] if self.photo_index < len(self.photos) else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def progress(self) -> float:
        """Progress, 0..1."""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    def with_step(self, step: FitStep) -> FitHistory:
        """Add a step; beyond :data:`MAX_STEPS` keep only every other step and the newest."""
        steps = (*self.steps, step)
        return replace(self, steps=steps if len(steps) <= MAX_STEPS else (*steps[:-1:2], step))


class FitRequest(NamedTuple):
    """A fit to be run: its history so far, and the hypothesis to resume from, if any."""

    history: FitHistory
    resume_from: Hypothesis | None = None
    restored: bool = False  # from a run that ended during this fit, maybe after its result had joined the objects
    answered: int = 0  # number of photos, from the first, about which a person was asked


class Question(NamedTuple):
    """A photo that a person looks at before it is fitted."""

    request: FitRequest
    words: str
    cut: CutOut | None  # None where no object was found
    seen: SeenCutOut
    model: str  # fingerprint of the model that would fit it

    @property
    def number(self) -> int:
        """The index of the photo among those of the request."""
        return len(self.request.history.photos)

    @property
    def source(self) -> PhotoSource:
        """The photo asked about."""
        return self.request.history.sources[self.number]


def match_poses(paths: Sequence[Path]) -> tuple[tuple[PhotoSource, ...], tuple[Path, ...]]:
    """Sort files into images with the poses of the same names, and other files.

    A pose is a text of 16 numbers. Without an image, all other files count as images, so that reading them reports why
    they are not. Raises ``ValueError`` if there are only texts.
    """
    texts = {path.stem: path for path in paths if path.suffix.lower() == ".txt"}
    no_texts = [path for path in paths if path not in texts.values()]
    images = tuple(path for path in no_texts if _is_image(path)) or tuple(no_texts)
    if not images:
        raise ValueError(f"{paths[0].name}: there is no image beside it")
    poses = {stem: path for stem, path in texts.items() if optional(partial(read_numbers, path, 16))}
    sources = tuple(PhotoSource(path, poses.get(path.stem)) for path in images)
    used = {*images, *(source.pose for source in sources)}
    return sources, tuple(path for path in paths if path not in used)


def _is_image(path: Path) -> bool:
    """Recognise an image by name or content."""
    return path.suffix.lower() in IMAGE_SUFFIXES or optional(lambda: upright_size(path)) is not None


@dataclass(frozen=True)
class Ready:
    """A fitted object that is ready to be shown."""

    name: str
    camera: Camera  # its photo's camera, at the size of the model's images
