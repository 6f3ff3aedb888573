"""The history of a fit: photos, steps, and which of them is shown. All frozen."""

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

_AROUND = 0.08  # of the object's size, that is shown around it
MAX_STEPS = 800  # kept; of more, every other one is forgotten


class PhotoSource(NamedTuple):
    """Where a photo comes from."""

    path: Path
    pose: Path | None = None  # its camera, where that is known: an SRN pose file
    hints: Hints | None = None  # where the object is, where a person pointed it out
    crop: Crop | None = None

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

    @classmethod
    def of(cls, source: PhotoSource, photo: Photo) -> FittedPhoto:
        """With its pixels as bytes."""
        return cls(source, photo, to_bytes(photo.pixels))

    @property
    def digest(self) -> str:
        """By which the photo is known again."""
        return hashlib.sha256(self.pixels.tobytes()).hexdigest()[:16]

    @cached_property
    def part(self) -> tuple[float, float, float, float]:
        """The part of the photo that shows the object, and a little around it: left, top, right, bottom, 0..1."""
        bounds = list[float]()
        for axis in (0, 1):
            there = (self.photo.mask > 0.5).any(axis).nonzero()[:, 0].tolist()
            size = self.photo.mask.shape[1 - axis]
            low, high = (there[0] / size, (there[-1] + 1) / size) if there else (0.0, 1.0)
            margin = _AROUND * (high - low)
            bounds += [max(0.0, low - margin), min(1.0, high + margin)]
        return bounds[0], bounds[2], bounds[1], bounds[3]

    def doubled_difference(self, render: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "height width 3"]:
        """Twice the absolute difference, at the photo's size; a render that is a preview is smaller."""
        enlarged = np.asarray(Image.fromarray(render).resize(self.pixels.shape[1::-1]), np.int16)
        return (2 * np.abs(self.pixels - enlarged)).clip(0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class FitHistory:
    """How a fit has gone so far."""

    sources: tuple[PhotoSource, ...] = ()
    photos: tuple[FittedPhoto, ...] = ()  # as many of the sources as have been read
    steps: tuple[FitStep, ...] = ()
    selected: int | None = None  # the step that is shown; None: the newest
    photo_index: int = 0  # the photo that is shown
    model: str = ""  # fingerprint of the model that is fitted; empty until the first photo's category is known
    frame: Frame | None = None  # the newest render of that step, from the photo's camera
    difference: UInt8[np.ndarray, "height width 3"] | None = None  # photo less render, doubled

    @property
    def name(self) -> str:
        """Of the object: that of its first photo."""
        return printable(self.sources[0].path.stem) if self.sources else ""

    @property
    def photo(self) -> FittedPhoto | None:
        """The photo that is shown, once it has been read."""
        return self.photos[self.photo_index] if self.photo_index < len(self.photos) else None

    @property
    def image(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The newest render on white, as the photo is."""
        return self.frame.image if self.frame else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def step(self) -> FitStep | None:
        """The step that is shown."""
        return self.steps[self.selected] if self.selected is not None else self.last

    @property
    def progress(self) -> float:
        """0..1"""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    def with_step(self, step: FitStep) -> FitHistory:
        """With a step more; where there are too many, only every other one is kept, and the newest."""
        steps, selected = (*self.steps, step), self.selected
        if len(steps) > MAX_STEPS:
            steps, selected = (*steps[:-1:2], step), selected and selected // 2
        return replace(self, steps=steps, selected=selected)

    def up_to_selected(self) -> FitHistory:
        """Without the steps after the one that is shown."""
        kept = len(self.steps) if self.selected is None else self.selected + 1
        return replace(self, steps=self.steps[:kept], selected=None)


class FitRequest(NamedTuple):
    """A fit that is wanted: what there is of it already, and from which hypothesis it goes on, if not from anew."""

    history: FitHistory
    resume_from: Hypothesis | None = None
    restored: bool = False  # of a run that ended in it, maybe after its result had joined the objects


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
