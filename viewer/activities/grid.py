"""The grid: shapes of chosen objects in rows, their textures in columns, a thumbnail for every pair."""

from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from PIL import Image

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.scene import IMAGE_FORMATS
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from core.runtime.files import atomic_file
from viewer.services.jobs import Jobs
from viewer.values.history import Pair
from viewer.values.objects import ObjectLibrary
from viewer.values.variety import readable

MAX_OBJECTS = 8  # 64 pairs are as many as a panel can show


class Grid:
    """Chosen objects, and their pairs."""

    def __init__(self, jobs: Jobs, objects: ObjectLibrary) -> None:
        self._jobs, self._objects = jobs, objects
        self.names: tuple[str, ...] = ()

    @property
    def rows(self) -> list[list[Pair]]:
        """The pairs: a row has one shape, a column one texture."""
        return [[Pair(shape, texture) for texture in self.names] for shape in self.names]

    def add(self, *names: str) -> None:
        """Add objects that are not in the grid yet; says for which there is no room. Those of another model than the
        grid's begin a grid anew.
        """
        wanted = tuple(dict.fromkeys((*self.names, *names)))
        newest = self._objects[wanted[-1]].codes.model if wanted else ""
        other = [name for name in wanted if self._objects[name].codes.model != newest]
        wanted = tuple(name for name in wanted if name not in other)
        if other:
            self._jobs.messages.notify(
                f"The grid begins anew: {readable(other[0])} cannot be mixed with what was added"
            )
        self.names = wanted[:MAX_OBJECTS]
        if left_out := wanted[MAX_OBJECTS:]:
            self._jobs.messages.notify(
                f"A grid holds {MAX_OBJECTS} objects; there is no room for {', '.join(left_out)}"
            )

    def remove(self, name: str) -> None:
        """Take an object out."""
        self.names = tuple(other for other in self.names if other != name)

    def rename(self, name: str, to: str) -> None:
        """An object has another name."""
        self.names = tuple(to if other == name else other for other in self.names)

    def clear(self) -> None:
        """An empty grid."""
        self.names = ()


def write_grid(
    render: Callable[[RenderJob], Iterator[Frame | None]], rows: list[list[Codes]], camera: Camera, path: Path
) -> Iterator[float]:
    """Write all pairs as one image on white.

    Yields the share that is done; nothing is left at ``path`` unless the image is whole: to cancel, close the
    generator. Raises ``ValueError`` for a name of another format, or a path that cannot be written.

    Args:
        camera: of every cell, at the size of a cell.
    """
    if path.suffix.lower() not in IMAGE_FORMATS:
        raise ValueError(f"{path.name}: the name of a grid ends in {', '.join(IMAGE_FORMATS)}")
    across, down, height, width = len(rows[0]), len(rows), camera.height, camera.width
    whole = np.empty((down * height, across * width, 3), np.uint8)
    with atomic_file(path) as partial:
        for row, column in product(range(down), range(across)):
            for frame in render(RenderJob(rows[row][column], camera, RenderSettings(divisors=(1,)))):
                if frame:
                    whole[row * height :, column * width :][:height, :width] = frame.image
                yield (row * across + column) / (down * across)
        Image.fromarray(whole).save(partial)
    yield 1.0
