"""Exports: seconds and size of each kind of file."""

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from core.export.films import turntable
from core.export.framing import filling_frame
from core.export.mesh import MeshSettings, export_mesh
from core.export.page import first_camera, write_page
from core.export.video import write_video
from core.geometry.camera import Camera
from core.lab.benchmarks.held_out_views import HeldOutView, Trial, timed
from core.models.model import Instance

_SIDE = 384  # px of a video's frames
_FRAMES = 48  # of a turn
_TEXTURE = 1024  # px


@dataclass(frozen=True)
class ExportTrial(Trial):
    """A file of a fitted object."""

    n: int  # files
    seconds: float  # of the processor
    megabytes: float


def _mesh(instance: Instance, _: Camera, path: Path, texture: int = 0) -> Iterable[object]:
    return export_mesh(instance, path, MeshSettings(texture=texture))


def _video(instance: Instance, camera: Camera, path: Path) -> Iterable[object]:
    return write_video(filling_frame(turntable(instance, camera.resized(_SIDE, _SIDE), _FRAMES)), path)


def _page(instance: Instance, camera: Camera, path: Path) -> Iterable[object]:
    return write_page(instance, first_camera(instance, camera), path, instance.model.noun)


_EXPORTS: dict[str, tuple[str, Callable[[Instance, Camera, Path], Iterable[object]]]] = {
    "glb": (".glb", _mesh),
    "glb, textured": (".glb", partial(_mesh, texture=_TEXTURE)),
    "stl": (".stl", _mesh),
    "page": (".html", _page),
    "mp4": (".mp4", _video),
    "obj": (".obj", _mesh),
    "3mf": (".3mf", _mesh),
    "gif": (".gif", _video),
    "webp": (".webp", _video),
}  # ending and writer


def cases(quick: bool) -> tuple[str, ...]:
    """Return the kinds of files, of which five are written quickly."""
    return tuple(_EXPORTS)[: 5 if quick else None]


def measure(view: HeldOutView, case: str) -> tuple[ExportTrial]:
    """Write a file of a fitted object; videos and pages need OpenGL to be fast."""
    suffix, write = _EXPORTS[case]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"object{suffix}"
        seconds, _ = timed(lambda: list(write(view.instance, view.usual_camera, path)))
        return (ExportTrial(*view.key(case), 1, seconds, path.stat().st_size / 1e6),)
