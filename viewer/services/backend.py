"""The functions of core that the window calls, replaceable in tests."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from core.detail.progressive import Frame, RenderJob, render_progressively
from core.editing.bounds import Bounds, natural_bounds
from core.editing.paint import CoarsePaint, Paint, coarse_paint, paint, paint_colour
from core.editing.parts import Box, PartMap, part_map
from core.editing.words import Words, direction_words
from core.edits.paint import Rgb
from core.export.films import View
from core.export.framing import filling_distance
from core.export.mesh import export_mesh
from core.export.page import PageExtras, write_page
from core.export.video import VideoSettings, write_video
from core.export.video_frames import Image, render_frames
from core.fitting.fit import FitJob, FitStep, fit
from core.geometry.camera import Camera
from core.gl.baked_field import BakedField
from core.gl.baking import bake
from core.models.library import load_model
from core.models.model import Instance, Model
from core.photos.clip_object import ClipCuts, cut_out_clip
from core.photos.photo import Photo, naming, prepare_photo, read_cut_out
from core.photos.segmentation import CutOut, Hints
from core.photos.view_bank import build_view_bank
from viewer.values.fit_history import PhotoSource


def frame_photo(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
    """Prepare a photo's cut-out object, with its side, for a fit. Raises ``ValueError`` naming the photo."""
    with naming(source.path):
        return replace(prepare_photo(cut, model), side=source.side)


@dataclass(frozen=True)
class Backend:
    """One function per kind of value. Generators yield None as mere progress; the default documents each field."""

    load_model: Callable[[str], Model] = load_model
    cut_out: Callable[[Path, Hints | None], CutOut] = read_cut_out
    clip: Callable[[Path], Generator[float, None, ClipCuts]] = cut_out_clip
    frame_photo: Callable[[CutOut, Model, PhotoSource], Photo] = frame_photo
    frames: Callable[[RenderJob], Iterator[Frame | None]] = render_progressively
    fit: Callable[[Model, FitJob], Iterator[FitStep]] = fit
    view_bank: Callable[[Model], Iterator[float]] = build_view_bank
    pictures: Callable[..., Iterator[Image | None]] = render_frames
    video: Callable[[list[View], Path, VideoSettings], Iterator[int]] = write_video
    mesh: Callable[..., Generator[float, None, str]] = export_mesh
    page: Callable[[Instance, Camera, Path, str, PageExtras], Iterator[float | None]] = write_page
    guess_category: Callable[[CutOut], dict[str, float]] = lambda cut: cut.categories
    direction_words: Callable[[Model], Iterator[Words | None]] = direction_words
    bake: Callable[[Instance], Iterator[BakedField | None]] = bake
    part_map: Callable[[Instance, Camera, Frame, Box], PartMap] = part_map
    paint_colour: Callable[[Instance, str], Generator[None, None, Rgb]] = paint_colour
    paint: Callable[[Instance, Paint], Generator[None, None, Instance]] = paint
    coarse_paint: Callable[[Instance, Camera, Frame, str], CoarsePaint] = coarse_paint
    distance: Callable[[Instance, Camera, float], float] = filling_distance
    bounds: Callable[[Instance], Bounds] = natural_bounds
