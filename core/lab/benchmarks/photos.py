"""Fits of ordinary photographs, compared with labels by eye.

A small CSV file labels each photo of a folder: the category, the box around the whole object in fractions of the image,
and the viewpoint. An object that lies on its side has no azimuth. A photo of two objects has a line for each: either
may be fitted.
"""

import math
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import torch

from core.fitting.category_check import likeliest_model
from core.fitting.fit import PRESETS, FitJob, fit
from core.geometry.camera import Camera, camera_rotation
from core.lab.benchmarks.results import read_frame
from core.models.library import load_model
from core.photos.decode import read_rgba
from core.photos.detector import Box, box_overlap, mask_box
from core.photos.photo import prepare_photo
from core.photos.segmentation import CutOut, cut_out

KEY = ("photo",)  # of a trial
RIGHT_DEGREES = 30.0  # largest error of a right azimuth
_WHOLE, _PART = 0.8, 0.3  # intersection over union with the labelled box of a whole cut-out, and of a part


@dataclass(frozen=True)
class Judgement:
    """The visual judgement of an object in a photo."""

    photo: str  # the file's name without its ending
    category: str
    left: float
    top: float
    right: float
    bottom: float
    azimuth: float | None  # degrees; None if the object lies on its side
    elevation: float | None

    @property
    def box(self) -> Box:
        """The box in fractions of width and height."""
        return self.left, self.top, self.right, self.bottom


@dataclass(frozen=True)
class PhotoTrial:
    """The results of a photo."""

    photo: str
    category: str  # as labelled
    taken_for: str
    detected: str  # the detector's box: whole, part or wrong; "" if it found nothing
    cut_out: str  # whole, part or wrong, by the box
    found_by: str
    mask_confidence: float
    azimuth: float
    elevation: float  # degrees
    right_side: bool | None  # None without a labelled side
    psnr: float
    confidence: float
    witness: float | None  # degrees, the azimuth by the 3D box of a chair
    seconds: float  # of the processor, cut-out and fit


def read_judgements(path: Path) -> dict[str, tuple[Judgement, ...]]:
    """Read the labels by photo. Raise ``ValueError`` if the file does not parse."""
    frame = read_frame(path, [field.name for field in fields(Judgement)]).astype(object)
    records = frame.where(frame.notna(), None).sort_values("photo").to_dict("records")
    judgements = (Judgement(**record) for record in records)
    return {name: tuple(group) for name, group in groupby(judgements, key=attrgetter("photo"))}


def measure_photos(
    files: Sequence[Path], judgements: Mapping[str, Sequence[Judgement]], preset: str, done: Collection[tuple[str]] = ()
) -> Iterator[PhotoTrial]:
    """Fit each photo without a hint, as ``fit`` does, except those whose keys are done; yield its results."""
    for path in (file for file in files if (file.stem,) not in done):
        yield measure_photo(path, judgements[path.stem], preset)


def measure_photo(path: Path, judgements: Sequence[Judgement], preset: str) -> PhotoTrial:
    """Fit one photo and compare it with its labels."""
    began = time.process_time()
    cut = cut_out(read_rgba(path))
    taken_for = likeliest_model(cut.categories)
    model = load_model(taken_for)
    *_, last = fit(model, FitJob((prepare_photo(cut, model),), PRESETS[preset]))
    nearest = max(judgements, key=lambda judgement: _overlap(judgement.box, cut))
    camera = last.cameras[0]
    return PhotoTrial(
        path.stem,
        nearest.category,
        taken_for,
        _grade(box_overlap(nearest.box, cut.detections[0].box)) if cut.detections else "",
        _grade(_overlap(nearest.box, cut)),
        cut.found_by,
        cut.confidence,
        math.degrees(camera.azimuth),
        math.degrees(camera.elevation),
        _right_side(nearest, camera),
        last.psnr,
        last.confidence or 0.0,
        None if cut.direction is None else math.degrees(cut.direction[0]),
        time.process_time() - began,
    )


def _grade(overlap: float) -> str:
    return "whole" if overlap >= _WHOLE else "part" if overlap >= _PART else "wrong"


def _overlap(box: Box, cut: CutOut) -> float:
    """Return the intersection over union of a box and the mask's box."""
    return box_overlap(box, mask_box(cut.mask))


def _right_side(judgement: Judgement, camera: Camera) -> bool | None:
    """Return whether a camera agrees with the labelled azimuth; None without one."""
    if judgement.azimuth is None or judgement.elevation is None:
        return None
    looks = [
        camera_rotation(torch.tensor(azimuth), torch.tensor(elevation))[2]
        for azimuth, elevation in (
            (camera.azimuth, camera.elevation),
            (math.radians(judgement.azimuth), math.radians(judgement.elevation)),
        )
    ]
    return math.degrees(math.acos(min(1.0, float(looks[0] @ looks[1])))) < RIGHT_DEGREES
