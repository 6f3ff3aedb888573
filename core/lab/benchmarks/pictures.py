"""Pictures of the benchmarks: shapes and textures exchanged, fits of several photos, fits that are wrong and sure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from PIL import Image

from core.detail.progressive import render_frame
from core.fitting.fit import PRESETS, FitJob, fit
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.lab.benchmarks.fits import DEFAULT, PHOTO_COUNTS
from core.lab.benchmarks.held_out_views import MOST_PHOTOS, held_out_view
from core.lab.benchmarks.stability import corrupted_photos, surest_mistakes
from core.lab.benchmarks.stressors import STRESSORS
from core.lab.datasets.srn import evenly_spaced, index_objects
from core.metrics import rotation_error
from core.models.model import Instance

EXCHANGE, FAILURE, PHOTOS = "exchange.png", "failure.png", "photos.png"
_SIDE = 160  # px of an image
_OBJECTS = 4  # of each category that exchange textures


def draw_exchange(datasets: tuple[Path, ...], out: Path) -> None:
    """Draw every shape (a row) in every texture (a column) of a few objects, the categories side by side."""
    blocks = []
    for folder in datasets:
        category, entries = index_objects([folder])
        views = [held_out_view(datasets, category, entry.name, 0) for entry in evenly_spaced(entries, _OBJECTS)]
        camera = views[0].usual_camera
        instances = [view.instance for view in views]
        rows = [[_image(shape.with_texture(texture), camera) for texture in instances] for shape in instances]
        blocks.append(_grid(rows))
    height = min(len(block) for block in blocks)
    Image.fromarray(np.concatenate([block[:height] for block in blocks], 1)).save(out / EXCHANGE)


def draw_failure(datasets: tuple[Path, ...], trials: pd.DataFrame, out: Path) -> None:
    """Draw the surest wrong fit of each category: its photo, the fit from there, another true view, the fit from there.

    Draws nothing where no fit of a photo is wrong.
    """
    rows = []
    for trial in surest_mistakes(trials).itertuples():
        view = held_out_view(datasets, str(trial.category), str(trial.name), int(trial.number))
        photos = corrupted_photos(view, STRESSORS[str(trial.stressor)], float(trial.level))
        *_, last = fit(view.model, FitJob(photos, PRESETS[DEFAULT], view.seed))
        instance = last.instance.with_detail(None)
        index = view.order[-1]
        fitted = [_resized(to_bytes(photos[0].pixels)), _image(instance, last.cameras[0])]
        second_view = [_resized(view.views.images[index]), _image(instance, view.views.cameras[index])]
        rows.append(fitted + second_view)
    if rows:
        Image.fromarray(_grid(rows)).save(out / FAILURE)


def draw_photos(datasets: tuple[Path, ...], out: Path) -> None:
    """Draw an object of each category, fitted to 1, 2, 3 and 5 photos, beside the truth.

    A row for each, seen from the view furthest from the first photo. Cameras are unknown; photo detail is left out.
    """
    rows = []
    for folder in datasets:
        category, entries = index_objects([folder])
        view = held_out_view(datasets, category, entries[0].name, 0)
        (first,) = view.cameras()
        furthest = max(view.order[MOST_PHOTOS:], key=lambda index: rotation_error(view.views.cameras[index], first))
        jobs = [FitJob(view.photos(count, False), PRESETS[DEFAULT], view.seed) for count in PHOTO_COUNTS]
        steps = [[*fit(view.model, job)][-1] for job in jobs]
        camera = view.views.cameras[furthest]
        row = [_image(step.instance.with_detail(None), camera) for step in steps]
        rows.append([*row, _resized(view.views.images[furthest])])
    Image.fromarray(_grid(rows)).save(out / PHOTOS)


def _resized(image: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "side side 3"]:
    return np.asarray(Image.fromarray(image).resize((_SIDE, _SIDE), Image.Resampling.BICUBIC))


def _image(instance: Instance, camera: Camera) -> UInt8[np.ndarray, "side side 3"]:
    return render_frame(instance, camera.resized(_SIDE, _SIDE)).image


def _grid(rows: Sequence[Sequence[UInt8[np.ndarray, "side side 3"]]]) -> UInt8[np.ndarray, "height width 3"]:
    return np.concatenate([np.concatenate(row, 1) for row in rows])
