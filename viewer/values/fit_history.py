"""What a fit is made of and how it has gone so far: photos, steps, and what is looked at. All frozen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import UInt8

from core.fitting.fit import FitStep
from core.photos.photo import Framing, Photo
from core.photos.segmentation import Hints
from core.rendering.progressive import Frame

_MOST_STEPS = 800
"""kept; of more, every other one is forgotten"""


class Source(NamedTuple):
    """Where a photo comes from."""

    path: Path
    pose: Path | None = None
    """its camera, where that is known: a file of SRN"""
    hints: Hints | None = None
    """where the object is, where somebody said so"""
    framing: Framing | None = None


@dataclass(frozen=True, eq=False)
class Shot:
    """A photo that is fitted."""

    source: Source
    photo: Photo
    pixels: UInt8[np.ndarray, "height width 3"]

    @classmethod
    def of(cls, source: Source, photo: Photo) -> Shot:
        """With its pixels as bytes."""
        return cls(source, photo, (photo.pixels.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy())


@dataclass(frozen=True, eq=False)
class Course:
    """How a fit has gone so far."""

    sources: tuple[Source, ...] = ()
    shots: tuple[Shot, ...] = ()
    """as many of the sources as have been read"""
    steps: tuple[FitStep, ...] = ()
    at: int | None = None
    """the step that is looked at; None: the newest"""
    view: int = 0
    """which photo is looked at"""
    picture: Frame | None = None
    """the newest picture of that step, from the photo's camera"""
    difference: np.ndarray | None = None
    """between the photo and that picture, doubled; uint8, black where they agree"""

    @property
    def name(self) -> str:
        """Of the object: that of its first photo."""
        return self.sources[0].path.stem if self.sources else ""

    @property
    def shot(self) -> Shot | None:
        """The photo that is looked at, once it has been read."""
        return self.shots[self.view] if self.view < len(self.shots) else None

    @property
    def shown(self) -> np.ndarray | None:
        """The newest picture on white, as the photo is."""
        return self.picture.image if self.picture else None

    @property
    def last(self) -> FitStep | None:
        """The newest step: the result, once the fit is over."""
        return self.steps[-1] if self.steps else None

    @property
    def step(self) -> FitStep | None:
        """The step that is looked at."""
        return self.steps[self.at] if self.at is not None else self.last

    @property
    def progress(self) -> float:
        """0..1"""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    def stepped(self, step: FitStep) -> Course:
        """With a step more; where there are too many, only every other one is kept, and the newest."""
        steps, at = (*self.steps, step), self.at
        if len(steps) > _MOST_STEPS:
            steps, at = (*steps[:-1:2], step), at and at // 2
        return replace(self, steps=steps, at=at)


def paired(paths: Sequence[Path]) -> tuple[Source, ...]:
    """Images with the pose files that have their names. Raises ``ValueError`` for a pose without its image."""
    poses = {path.stem: path for path in paths if path.suffix.lower() == ".txt"}
    images = [path for path in paths if path.suffix.lower() != ".txt"]
    sources = tuple(Source(path, poses.pop(path.stem, None)) for path in images)
    if poses:
        raise ValueError(f"{next(iter(poses.values())).name}: there is no image of this name beside the pose")
    return sources
