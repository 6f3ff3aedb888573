"""Render objects from a split's cameras and write the dataset."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.lab.datasets.categories import Split
from core.lab.datasets.rasteriser import Rasteriser, Surface
from core.lab.datasets.splits import split_cameras
from core.lab.datasets.srn import ObjectViews, write_manifest, write_object
from core.runtime.reading import open_image


@dataclass(frozen=True)
class RenderTask:
    """An object to render."""

    name: str
    shape_id: str
    texture_id: str
    surfaces: Callable[[], Sequence[Surface]]  # called only when the object is rendered


def render_objects(
    tasks: Sequence[RenderTask], out: Path | str, category: str, split: Split, views: int, size: int
) -> Iterator[str]:
    """Render the tasks into the dataset ``out``, yielding each name when it is done.

    Skips objects that exist with as many views of this size, so a stopped job resumes. Raises ``RuntimeError`` without
    OpenGL, ``ValueError`` for an object that cannot be built.
    """
    if views < 1 or size < 1:
        raise ValueError(f"views and size must be positive, got {views} and {size}")
    write_manifest(out, category, {task.name: (task.shape_id, task.texture_id) for task in tasks})
    with Rasteriser(size) as rasteriser:
        for task in tasks:
            if not _is_rendered(Path(out) / task.name, views, size):
                rasteriser.upload(task.surfaces())
                cameras = split_cameras(split, views, task.name, category, size)
                images, masks = zip(*(rasteriser.render(camera) for camera in cameras), strict=True)
                identity = (task.name, task.shape_id, task.texture_id)
                write_object(out, ObjectViews(*identity, np.stack(images), np.stack(masks), cameras))
            yield task.name


def _is_rendered(folder: Path, views: int, size: int) -> bool:
    """True if an object's folder holds this many images of this size."""
    paths = list((folder / "rgb").glob("*.png"))
    if len(paths) != views:
        return False
    with open_image(paths[0]) as opened:
        return opened.size == (size, size)
