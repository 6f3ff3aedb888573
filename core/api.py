"""The library's face: what :mod:`core` offers by name. Every function is one call; the streams are underneath.

Files are named by a path or a text. Angles are radians, images are rows of pixels from the top.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from core.detail.progressive import render_frame
from core.editing.size import sized
from core.export import mesh, page, video
from core.export.films import TURN, View, turntable
from core.export.framing import filling_frame
from core.export.mesh import MeshSettings
from core.export.video import VideoSettings
from core.fitting import fit as fitting
from core.fitting.confidence import DOUBTFUL
from core.fitting.photo_views import resume_point
from core.fitting.settings import FitSettings
from core.fitting.steps import FitStep
from core.geometry.camera import Camera
from core.models.library import load_model
from core.models.model import Instance, Model
from core.models.scene import Scene
from core.photos.clip import is_clip
from core.photos.clip_object import load_clip
from core.photos.photo import Photo, load_photo

__all__ = [
    "Camera",
    "Instance",
    "Model",
    "Photo",
    "Scene",
    "camera_of",
    "export_mesh",
    "fit",
    "load_clip",
    "load_model",
    "load_photo",
    "render",
    "sized",
    "write_page",
    "write_video",
]

SIZE = 512  # px, usual side of a frame
SETTINGS = FitSettings()
_AZIMUTH = math.radians(60)  # of the usual view
_ELEVATION = math.radians(20)
_PROGRESS_STEPS = 10  # steps of a fit between two lines of progress


def fit(
    model: Model,
    photo: Photo | Path | str | Sequence[Photo | Path | str],
    progress: Callable[[str], object] | None = None,
    settings: FitSettings | None = None,
    seed: int = 0,
    resume: Instance | None = None,
) -> Instance:
    """Find the object of one or several photos, and their cameras: ``instance.detail.views[0].camera``.

    :func:`core.fitting.fit.fit` has every step of it, with a confidence for each photo.

    Args:
        photo: a prepared one (:func:`load_photo`), or a file, whose object is cut out; a video is several photos. Or up
            to 12 of the same object, of which those that show another one are left out.
        progress: called with one readable line now and then.
        settings: cost and parts of the fit; None: about ten seconds on an ordinary processor.
        seed: of the random numbers; the same seed gives the same object.
        resume: an object that was fitted to other photos, of which it keeps four. It finds the cameras of the new ones,
            and all is refined without its edits, in a fraction of the time of a new search.

    Raises ``ValueError`` for a file that is no image of an object, a fit that diverged from every start, or an object
    without photos.

    Example:
        >>> import core
        >>> model = core.load_model("chairs")
        >>> hasty = FitSettings(hypotheses=4, steps=4, rays=64, samples=32, free_steps=1, max_restarts=0)
        >>> chair = core.fit(model, "assets/samples/chairs/cushion.png", settings=hasty)
        >>> chair.model is model, chair.codes.shape.shape, len(chair.detail.views)
        (True, torch.Size([64]), 1)
    """
    say = progress or (lambda line: None)
    kept_photos, hypothesis = resume_point(resume) if resume else ((), None)
    photos = list(kept_photos)
    for source in [photo] if isinstance(photo, Photo | Path | str) else photo:
        if isinstance(source, Photo):
            photos.append(source)
        else:
            say(f"Cutting out {source}")
            photos += load_clip(source, model) if is_clip(source) else [load_photo(source, model)]
    last: FitStep | None = None
    for last in fitting.fit(model, fitting.FitJob(tuple(photos), settings or SETTINGS, seed, hypothesis)):
        if last.step % _PROGRESS_STEPS == 0:
            say(f"Step {last.step} of {last.steps}, {last.psnr:.1f} dB")
    assert last is not None, "a fit has a step"
    say(_described(last))
    return last.instance


def _described(last: FitStep) -> str:
    """Describe the result of a fit in a line."""
    camera = last.cameras[0]
    angles = f"azimuth {math.degrees(camera.azimuth):.0f}°, elevation {math.degrees(camera.elevation):.0f}°"
    if last.confidence is None:
        return f"Found at {angles}"
    doubt = "; in doubt, look at a render" if last.confidence < DOUBTFUL else ""
    if last.left_out:
        numbers = ", ".join(str(number + 1) for number in last.left_out)
        doubt += f"; without photo {numbers}, which looks like another object"
    return f"Found at {angles}, with confidence {last.confidence:.2f}{doubt}"


def camera_of(instance: Instance, size: int | tuple[int, int] = SIZE) -> Camera:
    """Return the camera of the object's photo; without photos, a usual one that shows all of it.

    Args:
        size: px of the image: its side, or width and height.

    Example:
        >>> import core
        >>> camera = core.camera_of(core.load_model("chairs")[0], (320, 240))
        >>> camera.width, camera.height, round(math.degrees(camera.azimuth))
        (320, 240, 60)
    """
    width, height = (size, size) if isinstance(size, int) else size
    if instance.detail:
        return instance.detail.views[0].camera.resized(width, height)
    camera = instance.model.camera(_AZIMUTH, _ELEVATION).resized(width, height)
    return filling_frame([View(instance, camera)])[0].camera


def render(instance: Instance, camera: Camera | None = None) -> UInt8[np.ndarray, "height width 3"]:
    """Return an image of an object on white, sRGB, as large as the camera.

    Args:
        camera: None: that of :func:`camera_of`.

    Raises ``ValueError`` for the paper's ablations M1 and M2, which only
    :func:`core.rendering.reference.render_exact` renders.

    Example:
        >>> import core
        >>> chair = core.load_model("chairs")[3]
        >>> image = core.render(chair, core.camera_of(chair, size=64))
        >>> image.shape, image.dtype
        ((64, 64, 3), dtype('uint8'))
    """
    return render_frame(instance, camera or camera_of(instance)).image


def write_video(
    instance: Instance,
    path: Path | str,
    camera: Camera | None = None,
    frames: int = TURN,
    settings: VideoSettings | None = None,
) -> None:
    """Write a film of one turn around an object: .mp4, .gif, .webp or .frames, a folder of images.

    :func:`core.export.video.write_video` films any views, such as those of :func:`core.export.films.morph`.

    Args:
        camera: where the turn begins; None: that of :func:`camera_of`. Its size is that of the frames.
        frames: of the turn.
        settings: frames per second, quality, background.

    Raises ``ValueError`` for an unknown ending, or a path that cannot be written.

    Example:
        >>> import core, tempfile
        >>> chair = core.load_model("chairs")[3]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     core.write_video(chair, f"{folder}/chair.gif", core.camera_of(chair, size=32), frames=2)
        ...     (Path(folder) / "chair.gif").stat().st_size > 0
        True
    """
    views = filling_frame(turntable(instance, camera or camera_of(instance, SIZE), frames))
    for _ in video.write_video(views, Path(path), settings):
        pass


def export_mesh(
    instance: Instance,
    path: Path | str,
    settings: MeshSettings | None = None,
    variants: Mapping[str, Instance] | None = None,
) -> None:
    """Write an object as a mesh with colours and named parts: .glb, .usdz, .ply, .obj, .stl or .3mf.

    Args:
        settings: resolution, size in metres, texture, number of triangles. Without a size, an object that was not
            :func:`sized` is in scene units: a photo shows no scale, and the diagonal of its box is about 1.
        variants: of a .glb: objects of the same shape by name, whose colours it holds.

    Raises ``ValueError`` for an unknown ending, an object without a surface, variants of other shapes, or a path that
    cannot be written.

    Example:
        >>> import core, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     core.export_mesh(core.load_model("chairs")[3], f"{folder}/chair.glb", MeshSettings(resolution=24))
        ...     (Path(folder) / "chair.glb").stat().st_size > 0
        True
    """
    for _ in mesh.export_mesh(instance, Path(path), settings, variants=variants):
        pass


def write_page(instance: Instance, path: Path | str, name: str = "", camera: Camera | None = None) -> None:
    """Write an object as a web page, one .html that turns in any browser without a network.

    Args:
        name: shown below the object; "" for the noun of its category.
        camera: first view; None: that of :func:`camera_of`, zoomed so that the object stays in sight all around.

    Raises ``ValueError`` for another ending, or a path that cannot be written.

    Example:
        >>> import core, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     core.write_page(core.load_model("chairs")[3], f"{folder}/chair.html")
        ...     (Path(folder) / "chair.html").stat().st_size < 2_000_000
        True
    """
    first = camera or page.first_camera(instance, camera_of(instance))
    for _ in page.write_page(instance, first, Path(path), name or instance.model.noun.capitalize()):
        pass
