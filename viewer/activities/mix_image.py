"""Mixes of objects A and B as one image: the amount of B's shape grows to the right, of its texture upwards."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.scene import IMAGE_FORMATS
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from core.runtime.files import atomic_file

STEPS = 5  # mixes along each side


def mixes(a: Codes, b: Codes) -> dict[tuple[int, int], Codes]:
    """Return the mixes by column and row, counted from A in the lower left corner; the corners come first."""
    order = sorted(range(STEPS), key=lambda step: -abs(step - STEPS // 2))
    last = STEPS - 1
    return {(column, row): a.mixed(b, column / last, row / last) for row in order for column in order}


def write_mixes(
    render: Callable[[RenderJob], Iterator[Frame | None]],
    cells: dict[tuple[int, int], Codes],
    camera: Camera,
    path: Path,
) -> Iterator[float]:
    """Write all mixes as one image on white; yield the finished fraction.

    To cancel, close the generator: no partial file stays. Raises ``ValueError`` for another format or a path that
    cannot be written.

    Args:
        render: renders a job, as :meth:`Jobs.frames`.
        cells: mixes by column and row (:func:`mixes`).
        camera: camera of every cell, at a cell's size.
    """
    if path.suffix.lower() not in IMAGE_FORMATS:
        raise ValueError(f"{path.name}: the name of an image ends in {', '.join(IMAGE_FORMATS)}")
    height, width = camera.height, camera.width
    whole = np.empty((STEPS * height, STEPS * width, 3), np.uint8)
    with atomic_file(path) as partial:
        for number, ((column, row), codes) in enumerate(cells.items()):
            for frame in render(RenderJob(codes, camera, RenderSettings(divisors=(1,)))):
                if frame:
                    whole[(STEPS - 1 - row) * height :, column * width :][:height, :width] = frame.image
                yield number / len(cells)
        Image.fromarray(whole).save(partial)
    yield 1.0
