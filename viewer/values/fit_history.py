"""The history of a fit: photos, steps, and the selected step. All frozen."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from core.fitting.fit import FitStep, Hypothesis
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.photos.decode import IMAGE_SUFFIXES, upright_size
from core.photos.photo import Crop, Photo
from core.photos.segmentation import Hints
from core.rendering.progressive import Frame
from core.runtime.reading import optional, read_numbers
from viewer.values.printable import printable

_AROUND = 0.08  # margin shown around the object, relative to its size
MAX_STEPS = 800  # steps kept; beyond, every other one is dropped


class PhotoSource(NamedTuple):
    """Origin of a photo."""

    path: Path
    pose: Path | None = None  # its SRN pose file, if the camera is known
    hints: Hints | None = None  # a person's hints to the object, if any
    crop: Crop | None = None

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

    @classmethod
    def of(cls, source: PhotoSource, photo: Photo) -> FittedPhoto:
        """Build from a photo, converting its pixels to bytes."""
        return cls(source, photo, to_bytes(photo.pixels))

    @property
    def digest(self) -> str:
        """Hash that identifies the photo."""
        return hashlib.sha256(self.pixels.tobytes()).hexdigest()[:16]

    @cached_property
    def part(self) -> tuple[float, float, float, float]:
        """Region of the photo with the object and a margin: left, top, right, bottom, 0..1."""
        bounds = list[float]()
        for axis in (0, 1):
            there = (self.photo.mask > 0.5).any(axis).nonzero()[:, 0].tolist()
            size = self.photo.mask.shape[1 - axis]
            low, high = (there[0] / size, (there[-1] + 1) / size) if there else (0.0, 1.0)
            margin = _AROUND * (high - low)
            bounds += [max(0.0, low - margin), min(1.0, high + margin)]
        return bounds[0], bounds[2], bounds[1], bounds[3]

    def doubled_difference(self, render: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "height width 3"]:
        """Return twice the absolute difference at the photo's size; the render may be a smaller preview."""
        enlarged = np.asarray(Image.fromarray(render).resize(self.pixels.shape[1::-1]), np.int16)
        return (2 * np.abs(self.pixels - enlarged)).clip(0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class FitHistory:
    """The course of a fit so far."""

    sources: tuple[PhotoSource, ...] = ()
    photos: tuple[FittedPhoto, ...] = ()  # of the sources read so far
    steps: tuple[FitStep, ...] = ()
    selected: int | None = None  # the selected step; None: the newest
    photo_index: int = 0  # the selected photo
    model: str = ""  # fingerprint of the fitted model; empty until the first photo's category is known
    frame: Frame | None = None  # newest render of the selected step, from the photo's camera
    difference: UInt8[np.ndarray, "height width 3"] | None = None  # doubled difference of photo and render

    @property
    def name(self) -> str:
        """Name of the object: its first photo's."""
        return printable(self.sources[0].path.stem) if self.sources else ""

    @property
    def photo(self) -> FittedPhoto | None:
        """The selected photo, once it has been read."""
        return self.photos[self.photo_index] if self.photo_index < len(self.photos) else None

    @property
    def image(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The newest render on white, like the photo."""
        return self.frame.image if self.frame else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def step(self) -> FitStep | None:
        """The selected step."""
        return self.steps[self.selected] if self.selected is not None else self.last

    @property
    def progress(self) -> float:
        """Progress, 0..1."""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    def with_step(self, step: FitStep) -> FitHistory:
        """Add a step; beyond :data:`MAX_STEPS` keep only every other step and the newest."""
        steps, selected = (*self.steps, step), self.selected
        if len(steps) > MAX_STEPS:
            steps, selected = (*steps[:-1:2], step), selected and selected // 2
        return replace(self, steps=steps, selected=selected)

    def up_to_selected(self) -> FitHistory:
        """Drop the steps after the selected one."""
        kept = len(self.steps) if self.selected is None else self.selected + 1
        return replace(self, steps=self.steps[:kept], selected=None)


class FitRequest(NamedTuple):
    """A requested fit: its history so far, and the hypothesis to resume from (None: start anew)."""

    history: FitHistory
    resume_from: Hypothesis | None = None
    restored: bool = False  # from a run that ended during this fit, maybe after its result had joined the objects


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
