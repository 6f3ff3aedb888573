"""The history of a fit: photos, steps, and which of them is shown. All frozen."""

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

MAX_STEPS = 800  # kept; of more, every other one is forgotten


class PhotoSource(NamedTuple):
    """The origin of a photo: its file, and hints of a person."""

    path: Path
    pose: Path | None = None  # its camera, where that is known: an SRN pose file
    hints: Hints | None = None  # where the object is, where a person pointed it out

    @property
    def name(self) -> str:
        """Of its file, as the window can draw it."""
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
        """With its pixels as bytes."""
        return cls(source, photo, to_bytes(photo.pixels), seen)

    @property
    def digest(self) -> str:
        """By which the photo is known again."""
        return hashlib.sha256(self.pixels.tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class FitHistory:
    """The photos and steps of a fit so far."""

    sources: tuple[PhotoSource, ...] = ()
    photos: tuple[FittedPhoto, ...] = ()  # as many of the sources as have been read
    steps: tuple[FitStep, ...] = ()
    photo_index: int = 0  # the photo that is shown
    model: str = ""  # fingerprint of the model that is fitted; empty until the first photo's category is known

    @property
    def name(self) -> str:
        """Of the object: that of its first photo."""
        return printable(self.sources[0].path.stem) if self.sources else ""

    @property
    def photo(self) -> FittedPhoto | None:
        """The photo that is shown, once it has been read."""
        return self.photos[self.photo_index] if self.photo_index < len(self.photos) else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def progress(self) -> float:
        """0..1"""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    def with_step(self, step: FitStep) -> FitHistory:
        """With a step more; where there are too many, only every other one is kept, and the newest."""
        steps = (*self.steps, step)
        return replace(self, steps=steps if len(steps) <= MAX_STEPS else (*steps[:-1:2], step))


class FitRequest(NamedTuple):
    """A fit to be run: its history so far, and the hypothesis to resume from, if any."""

    history: FitHistory
    resume_from: Hypothesis | None = None
    restored: bool = False  # of a run that ended in it, maybe after its result had joined the objects
    answered: int = 0  # photos, the first ones, about which a person was asked


class Question(NamedTuple):
    """A photo that a person looks at before it is fitted."""

    request: FitRequest
    words: str
    cut: CutOut
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
    """Sort files into images, with the poses that have their names, and files that are neither.

    A pose is a text of 16 numbers. Without an image, all files but texts count as images: reading them says why they
    are none. Raises ``ValueError`` where there are only texts.
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
    """By its name, or by its content."""
    return path.suffix.lower() in IMAGE_SUFFIXES or optional(lambda: upright_size(path)) is not None


@dataclass(frozen=True)
class Ready:
    """A fitted object that can be shown."""

    name: str
    camera: Camera  # from where its photo was taken, at the size of the model's images
