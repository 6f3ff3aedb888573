"""Where values come from: core's streams, or a test's stand-ins."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from core.detail.frames import bake, render_progressively
from core.export.frames import Image, draw_still, render_frames
from core.export.framing import filling_distance
from core.export.keyframes import View
from core.export.mesh import export_mesh
from core.export.pace import Pace, measure_pace
from core.export.video import write_video
from core.fitting.category_check import guess_category
from core.fitting.fit import FitJob, FitStep, fit
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.library import load_model
from core.models.model import Model
from core.photos.direction_words import Words, direction_words
from core.photos.photo import Photo, load_photo
from core.photos.view_bank import build_view_bank
from core.rendering.baked_field import BakedField
from core.rendering.progressive import Frame, RenderJob


@dataclass(frozen=True)
class Backend:
    """One function for each kind of value; most of them are streams."""

    load_model: Callable[[str], Model] = load_model
    load_photo: Callable[..., Photo] = load_photo
    frames: Callable[[Model, RenderJob], Iterator[Frame | None]] = render_progressively
    fit: Callable[[Model, FitJob], Iterator[FitStep]] = fit
    view_bank: Callable[[Model], Iterator[float]] = build_view_bank
    pictures: Callable[..., Iterator[Image | None]] = render_frames
    draw: Callable[[BakedField, Camera, int, bool], Image | None] = draw_still
    video: Callable[..., Iterator[int]] = write_video
    pace: Callable[[Model, View], Iterator[Pace | None]] = measure_pace
    mesh: Callable[..., Iterator[float]] = export_mesh
    guess_category: Callable[[Photo], dict[str, float]] = lambda photo: guess_category(photo.pixels, photo.mask)
    direction_words: Callable[[Model], Iterator[Words | None]] = direction_words
    bake: Callable[[Model, Codes], Iterator[BakedField | None]] = bake
    distance: Callable[[Model, Codes, Camera, float], float] = filling_distance
