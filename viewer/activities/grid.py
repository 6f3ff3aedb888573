"""The cross sheet: shapes of chosen objects in rows, their textures in columns, every pair a small picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from core.files import whole_file
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.models.pictures import FORMATS
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from viewer.services.worker import Job
from viewer.values import orbit
from viewer.values.history import Pair

if TYPE_CHECKING:
    from viewer.session import Session

MOST = 8
"""objects: 64 pictures are as many as a panel can show"""
_SIZE = 96
"""px"""
_QUICK = RenderSettings(samples=64, stages=(1,))
_FULL = RenderSettings(stages=(1,))


class Sheet:
    """Chosen objects. Their pairs are drawn on the worker one after another, each once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.names: tuple[str, ...] = ()
        self._pictures: dict[Pair, Frame] = {}

    @property
    def rows(self) -> list[list[Pair]]:
        """The pairs: a row has one shape, a column one texture."""
        return [[Pair(shape, texture) for texture in self.names] for shape in self.names]

    def add(self, *names: str) -> None:
        """Put objects on the sheet that are not on it yet; those for which there is no room are told."""
        wanted = tuple(dict.fromkeys((*self.names, *names)))
        self.names = wanted[:MOST]
        if wanted[MOST:]:
            self._session.say(f"A sheet holds {MOST} objects; there is no room for {', '.join(wanted[MOST:])}")
        self._draw()

    def remove(self, name: str) -> None:
        """Take an object off the sheet."""
        self.names = tuple(other for other in self.names if other != name)
        self._pictures = {pair: frame for pair, frame in self._pictures.items() if name not in pair}
        self._draw()

    def clear(self) -> None:
        """An empty sheet."""
        self._session.worker.cancel("sheet")
        self.names, self._pictures = (), {}

    def picture(self, pair: Pair) -> Frame | None:
        """A pair's picture; None until it is drawn."""
        return self._pictures.get(pair)

    def _draw(self) -> None:
        model = self._session.model
        assert model is not None, "no model yet"
        missing = [pair for row in self.rows for pair in row if pair not in self._pictures]
        jobs = [(pair, self._session.pair(pair)) for pair in missing]
        self._session.worker.submit(
            Job("sheet", lambda: self._drawn(model, jobs), self._keep, self._session.reporting("Cannot draw the sheet"))
        )

    def _drawn(self, model: Model, jobs: list[tuple[Pair, Codes]]) -> Iterator[tuple[Pair, Frame] | None]:
        camera = orbit.home(model).resized(_SIZE, _SIZE)
        for pair, codes in jobs:
            for frame in self._session.streams.frames(model, RenderJob(codes, camera, _QUICK)):
                yield (pair, frame) if frame else None

    def _keep(self, drawn: tuple[Pair, Frame]) -> None:
        self._pictures[drawn[0]] = drawn[1]


def write_sheet(
    draw: Callable[[RenderJob], Iterator[Frame | None]], rows: list[list[Codes]], camera: Camera, path: Path
) -> Iterator[float]:
    """Write all pairs as one picture on white.

    Yields the share that is done; nothing is left at ``path`` unless the picture is whole: to cancel, close the
    generator. Raises ``ValueError`` for a name of another format, or a path that cannot be written.

    Args:
        camera: of every cell, at the size of a cell.
    """
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path.name}: a sheet is called {', '.join(FORMATS)}")
    across, down, height, width = len(rows[0]), len(rows), camera.height, camera.width
    whole = np.empty((down * height, across * width, 3), np.uint8)
    with whole_file(path) as partial:
        for row, column in product(range(down), range(across)):
            for frame in draw(RenderJob(rows[row][column], camera, _FULL)):
                if frame:
                    whole[row * height :, column * width :][:height, :width] = frame.image
                yield (row * across + column) / (down * across)
        Image.fromarray(whole).save(partial)
    yield 1.0
