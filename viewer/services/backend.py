"""Where values come from: core's streams, or a test's stand-ins."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from core.export.keyframes import Shot
from core.fitting.fit import FitJob, FitStep, fit
from core.models.codes import Codes
from core.models.library import load_model
from core.models.model import Model
from core.photos.photo import Photo, load_photo
from core.photos.view_bank import preparing
from core.rendering.progressive import Frame, RenderJob, frames


@dataclass(frozen=True)
class VideoOptions:
    """What core.export.video.VideoSettings holds; the video library is imported on the worker, as it takes its time."""

    size: int = 256
    """px, width and height"""
    rate: int = 24
    """frames per second"""
    quality: int = 85
    """1..100"""
    transparent: bool = False


def write_video(model: Model, shots: Sequence[Shot], path: Path, options: VideoOptions) -> Iterator[int]:
    """Write a video; see core.export.video. Yields how many frames are done."""
    from core.export.video import VideoSettings
    from core.export.video import film as stream

    return stream(model, shots, path, VideoSettings(**asdict(options)))


def export_mesh(model: Model, codes: Codes, path: Path, resolution: int | None = None) -> Iterator[float]:
    """Write a mesh; see core.export.mesh, imported on the worker, as the mesh libraries take their time."""
    from core.export.mesh import export_mesh as stream

    return stream(model, codes, path, resolution)


@dataclass(frozen=True)
class Backend:
    """One function for each kind of value; all but the first two are streams."""

    load_model: Callable[[str], Model] = load_model
    load_photo: Callable[..., Photo] = load_photo
    frames: Callable[[Model, RenderJob], Iterator[Frame | None]] = frames
    fit: Callable[[Model, FitJob], Iterator[FitStep]] = fit
    view_bank: Callable[[Model], Iterator[None]] = preparing
    video: Callable[..., Iterator[int]] = write_video
    mesh: Callable[..., Iterator[float]] = export_mesh
