"""The history of a fit: its photos and steps; requests for fits, and questions about photos."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from core.classifiers.viewpoint import Side
from core.fitting.fit import FitStep, Hypothesis
from core.fitting.photo_views import with_photo_detail
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.models.model import Instance
from core.photos.decode import upright_size
from core.photos.photo import Photo
from core.photos.segmentation import CutOut, Hints
from viewer.values.cut_out_preview import CutOutPreview
from viewer.values.printable import printable

MAX_STEPS = 800  # limit of kept steps, at which every other step is dropped


class PhotoSource(NamedTuple):
    """A photo to fit: its file, and a person's hints."""

    path: Path
    hints: Hints | None = None  # clicks, box and strokes that point out the object
    copy: Path | None = None  # copy of the file on this machine, which is read if it is there
    side: Side | None = None  # of the object that it shows, as a person says

    @property
    def file(self) -> Path:
        """The file to read."""
        return self.copy if self.copy and self.copy.is_file() else self.path

    @property
    def name(self) -> str:
        """The file's name as the window can draw it."""
        return printable(self.path.name)


@dataclass(frozen=True, eq=False)
class FittedPhoto:
    """A photo that was read and prepared for a fit."""

    source: PhotoSource
    photo: Photo
    preview: CutOutPreview | None = None  # the whole photo with its outline, saved smaller

    @cached_property
    def pixels(self) -> UInt8[np.ndarray, "height width 3"]:
        """The pixels of the photo as bytes."""
        return to_bytes(self.photo.pixels)


@dataclass(frozen=True, eq=False)
class FitHistory:
    """The photos and steps of a fit so far."""

    sources: tuple[PhotoSource, ...] = ()
    photos: tuple[FittedPhoto, ...] = ()  # the first of the sources, those read so far
    steps: tuple[FitStep, ...] = ()
    photo_index: int = 0  # the selected photo
    model: str = ""  # fingerprint of the fitted model; empty until the first photo's category is known

    @property
    def name(self) -> str:
        """The object's name, that of its first photo; empty without photos."""
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
        """The finished fraction of the fit's steps, 0..1."""
        return min(1.0, self.last.step / max(1, self.last.steps)) if self.last else 0.0

    @property
    def resume_point(self) -> Hypothesis | None:
        """The best hypothesis of the newest step; None if the fit cannot be resumed yet."""
        best = self.last.hypotheses[0] if self.last and self.last.hypotheses else None
        return best if best and self.can_resume(best) else None

    def resume_point_of(self, instance: Instance, camera: Camera) -> Hypothesis | None:
        """Return the resume point with an object and, for the selected photo, the direction of a camera."""
        if self.resume_point is None:
            return None
        cameras = list(self.resume_point.cameras)
        photo_camera = cameras[self.photo_index]  # keeps its distance: the other camera is not the photo's
        cameras[self.photo_index] = replace(photo_camera, azimuth=camera.azimuth, elevation=camera.elevation)
        return replace(self.resume_point, cameras=tuple(cameras), instance=instance)

    def stopped(self) -> FitHistory:
        """Return the history of a stopped fit: its last step has photo detail, as only full fits end with it."""
        if self.last is None or self.last.instance.detail or self.resume_point is None:
            return self
        detailed = with_photo_detail([fitted.photo for fitted in self.photos], self.last)
        return replace(self, steps=(*self.steps[:-1], detailed))

    def can_resume(self, hypothesis: Hypothesis) -> bool:
        """Return whether the fit can continue from a hypothesis, which needs a camera per photo."""
        return len(hypothesis.cameras) == len(self.photos)

    def without_photos(self, *numbers: int) -> FitHistory:
        """Return a history of the other photos, without steps."""
        remaining = [number for number in range(len(self.sources)) if number not in numbers]
        photos = tuple(self.photos[number] for number in remaining if number < len(self.photos))
        return FitHistory(tuple(self.sources[number] for number in remaining), photos, model=self.model)

    def with_side(self, number: int, side: Side | None) -> FitHistory:
        """Return a history, without steps, in which a photo shows a named side of the object."""
        source = self.sources[number]._replace(side=side)
        fitted = self.photos[number]
        fitted = replace(fitted, source=source, photo=replace(fitted.photo, side=side))
        sources = (*self.sources[:number], source, *self.sources[number + 1 :])
        photos = (*self.photos[:number], fitted, *self.photos[number + 1 :])
        return FitHistory(sources, photos, photo_index=number, model=self.model)

    def converted(self, change: Callable[[Instance], Instance]) -> FitHistory:
        """Return the history with changed objects; the same one if none is missing its model."""
        if not any(step.instance.is_missing for step in self.steps):
            return self

        def of_hypothesis(hypothesis: Hypothesis) -> Hypothesis:
            return replace(hypothesis, instance=change(hypothesis.instance))

        def of_step(step: FitStep) -> FitStep:
            return replace(step, instance=change(step.instance), hypotheses=tuple(map(of_hypothesis, step.hypotheses)))

        return replace(self, steps=tuple(map(of_step, self.steps)))

    def with_step(self, step: FitStep) -> FitHistory:
        """Return the history with another step; above :data:`MAX_STEPS`, every other older step is dropped."""
        steps = (*self.steps, step)
        return replace(self, steps=steps if len(steps) <= MAX_STEPS else (*steps[:-1:2], step))


class FitRequest(NamedTuple):
    """A fit to be run."""

    history: FitHistory  # its sources, and the photos and steps so far
    resume_from: Hypothesis | None = None  # None: search from the beginning
    answered: int = 0  # number of photos, from the first, whose questions were answered
    problem: str = ""  # reason why the fit failed; empty until then

    @property
    def refines(self) -> bool:
        """True if the fit resumes with the photos that it had."""
        return self.resume_from is not None and len(self.resume_from.cameras) == len(self.history.sources)


class Question(NamedTuple):
    """A question about a photo, to be answered before the fit; after a failed fit, whether to try again."""

    request: FitRequest
    words: str
    cut: CutOut | None = None  # None if no object was found, or the fit failed
    preview: CutOutPreview | None = None  # None if the fit failed before the photo was read
    model: str = ""  # fingerprint of the model that would fit the photo; empty if the category is in doubt
    neither: bool = False  # the photo looks like none of the categories

    @classmethod
    def of_failure(cls, request: FitRequest, preview: CutOutPreview | None = None) -> Question:
        """Return the question whether to try a failed fit again."""
        return cls(request, f"Cannot fit this photo: {request.problem}", None, preview, request.history.model)

    @property
    def number(self) -> int:
        """The photo's index among the sources of the request; the last one's if all photos were read."""
        return min(len(self.request.history.photos), len(self.request.history.sources) - 1)

    @property
    def is_about_category(self) -> bool:
        """True if the category is in doubt."""
        return bool(self.cut) and not self.model

    @property
    def is_failed(self) -> bool:
        """True after a failed fit."""
        return bool(self.request.problem)

    @property
    def is_unread(self) -> bool:
        """True until the photo in question has been read."""
        return len(self.request.history.photos) < len(self.request.history.sources)

    @property
    def source(self) -> PhotoSource:
        """The photo in question."""
        return self.request.history.sources[self.number]


def photo_sources(paths: Sequence[Path]) -> tuple[tuple[PhotoSource, ...], dict[Path, ValueError]]:
    """Return the photos among files, by their content, and the problems of the others."""
    sources = list[PhotoSource]()
    problems = dict[Path, ValueError]()
    for path in paths:
        try:
            upright_size(path)
        except ValueError as error:
            problems[path] = error
        else:
            sources.append(PhotoSource(path))
    return tuple(sources), problems


class Ready(NamedTuple):
    """A fitted object that is ready to be shown."""

    name: str
    camera: Camera  # of its photo, at the size of the model's images
