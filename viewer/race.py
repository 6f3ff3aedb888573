"""The race of a fit on screen: a tile for every hypothesis that was ever in it, with a small picture of it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from core.camera import Camera
from core.fit import FitStep, Hypothesis
from core.frames import Frame, RenderJob, RenderSettings
from core.model import Model
from viewer.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session

_NEAR = 45.0
"""degrees: one step turns no camera so far, so what is farther is another hypothesis of the same start"""
_LEADERS = 3
"""drawn at a time"""
_EVERY = 0.4
"""s between two rounds of pictures, which take their time from the fit"""
_SIZE = 40
"""px"""
_SETTINGS = RenderSettings(samples=24, stages=(1,))


@dataclass(frozen=True, eq=False)
class Tile:
    """A hypothesis as the window shows it."""

    name: int
    """in the order of appearance"""
    hypothesis: Hypothesis
    """as it was last heard of"""
    lost: float | None = None
    """seconds of the fit after which it was in the race no more; None while it is"""
    picture: Frame | None = None
    drawn: float = -math.inf
    """s on the monotonic clock, when the picture was asked for"""


def raced(tiles: Sequence[Tile], step: FitStep) -> tuple[Tile, ...]:
    """The tiles after a step: those in the race by their loss, then the losers, the latest first."""
    alive = [tile for tile in tiles if tile.lost is None]
    racing, count = list[Tile](), len(tiles)
    for hypothesis in step.race:
        tile = min(alive, key=lambda tile: _apart(tile, hypothesis), default=None)
        if tile is None or _apart(tile, hypothesis) > _NEAR:
            tile, count = Tile(count, hypothesis), count + 1
        else:
            alive.remove(tile)
        racing.append(replace(tile, hypothesis=hypothesis))
    fallen = [replace(tile, lost=step.seconds) for tile in alive]
    return (*racing, *fallen, *(tile for tile in tiles if tile.lost is not None))


def _apart(tile: Tile, hypothesis: Hypothesis) -> float:
    """Degrees by which the farthest camera has moved; infinite for hypotheses of different starts or pictures."""
    before, now = tile.hypothesis, hypothesis
    if before.start != now.start or len(before.cameras) != len(now.cameras):
        return math.inf
    return max(map(_moved, before.cameras, now.cameras))


def _moved(first: Camera, second: Camera) -> float:
    """Degrees between the directions of two cameras; cheap, as it is asked for many times a frame."""
    cosine = math.sin(first.elevation) * math.sin(second.elevation) + math.cos(first.elevation) * math.cos(
        second.elevation
    ) * math.cos(first.azimuth - second.azimuth)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


class Race:
    """The tiles of the fit under way, or of the last one. The leaders are drawn anew a few times a second."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.tiles: tuple[Tile, ...] = ()
        self._looked = 0.0

    def reset(self) -> None:
        """No race."""
        self._session.worker.cancel("race")
        self.tiles = ()

    def stepped(self, step: FitStep) -> None:
        """The fit has made a step."""
        self.tiles = raced(self.tiles, step)
        now = time.monotonic()
        if now - self._looked > _EVERY and not self._session.worker.busy("race"):
            self._looked = now
            self._draw([tile for tile in self.tiles if tile.lost is None])

    def _draw(self, racing: list[Tile]) -> None:
        model = self._session.model
        assert model is not None, "no model yet"
        # The leader is drawn in every round; the others, in the order of their loss, where the oldest pictures are.
        due = racing[:1] + sorted(racing[1:], key=lambda tile: tile.drawn)[: _LEADERS - 1]
        names = {tile.name for tile in due}
        now = time.monotonic()
        self.tiles = tuple(replace(tile, drawn=now) if tile.name in names else tile for tile in self.tiles)

        def ended(error: Exception | None) -> None:
            if error:
                self._session.report("Cannot draw the race", error)

        self._session.worker.submit(Job("race", lambda: self._drawn(model, due), self._keep, ended))

    def _drawn(self, model: Model, due: list[Tile]) -> Iterator[tuple[int, Frame] | None]:
        for tile in due:
            camera = tile.hypothesis.cameras[0].resized(_SIZE, _SIZE)
            for frame in self._session.streams.frames(model, RenderJob(tile.hypothesis.codes, camera, _SETTINGS)):
                yield (tile.name, frame) if frame else None

    def _keep(self, drawn: tuple[int, Frame]) -> None:
        name, picture = drawn
        self.tiles = tuple(replace(tile, picture=picture) if tile.name == name else tile for tile in self.tiles)
