"""The race of a fit on screen: a tile for every hypothesis that was ever in it, with a small picture of it."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

import torch

from core.fitting.fit import FitStep, Hypothesis
from core.geometry.camera import Camera
from core.models.model import Model
from core.models.precision import autocast
from core.rendering.progressive import Frame
from core.rendering.reference import render_exact
from viewer.services.worker import Job

if TYPE_CHECKING:
    from viewer.session import Session

_NEAR = 45.0
"""degrees: one step turns no camera so far, so what is farther is another hypothesis of the same start"""
_SHARE = 0.06
"""of the worker's time, which the fit has otherwise"""
_SIZE, _SAMPLES = 32, 16
"""px, and along a ray"""
_CLOSER = 1.5
"""Photos are framed with room around the object, for which a tile has none."""


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


def raced(tiles: Sequence[Tile], step: FitStep) -> tuple[Tile, ...]:
    """The tiles after a step: those in the race by their loss, then the losers, the latest first."""
    alive = [tile for tile in tiles if tile.lost is None]
    racing, fresh = list[Tile](), count(len(tiles))
    for hypothesis in step.race:
        tile = min(alive, key=lambda tile: _apart(tile, hypothesis), default=None)
        if tile is None or _apart(tile, hypothesis) > _NEAR:
            tile = Tile(next(fresh), hypothesis)
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
    """The tiles of the fit under way, or of the last one, drawn anew one by one while it runs."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.tiles: tuple[Tile, ...] = ()
        self._over = True

    def over(self) -> None:
        """The fit has ended: the tiles stay, and those that were out before their turn came get their picture now."""
        self._over = True
        self._draw()

    def reset(self, tiles: tuple[Tile, ...] = ()) -> None:
        """Another fit."""
        self._session.worker.cancel("race")
        self.tiles = tiles

    def stepped(self, step: FitStep) -> None:
        """The fit has made a step."""
        self.tiles, self._over = raced(self.tiles, step), False
        self._draw()

    def _draw(self) -> None:
        model = self._session.model
        assert model is not None, "no model yet"
        if self.tiles and not self._session.worker.busy("race"):
            self._session.worker.submit(
                Job(
                    "race",
                    lambda: self._drawn(model),
                    self._keep,
                    self._session.reporting("Cannot draw the race"),
                    share=_SHARE,
                )
            )

    def _drawn(self, model: Model) -> Iterator[tuple[int, Frame]]:
        """Every other picture is the leader's; between them comes whoever was drawn the longest ago. After the race
        come those that have no picture yet.
        """
        turns, drawn = count(), dict[int, int]()
        while waiting := [tile for tile in self.tiles if self._due(tile, drawn)]:
            turn = next(turns)
            tile = waiting[0] if turn % 2 else min(waiting, key=lambda tile: drawn.get(tile.name, -1))
            drawn[tile.name] = turn
            yield tile.name, _glance(model, tile.hypothesis)

    def _due(self, tile: Tile, drawn: Container[int]) -> bool:
        return tile.picture is None and tile.name not in drawn if self._over else tile.lost is None

    def _keep(self, drawn: tuple[int, Frame]) -> None:
        name, picture = drawn
        self.tiles = tuple(replace(tile, picture=picture) if tile.name == name else tile for tile in self.tiles)


def _glance(model: Model, hypothesis: Hypothesis) -> Frame:
    """A hypothesis from its camera, coarse. In each step it has another shape, for which the fast renderer would look
    up the occupied cells first; for so few pixels the reference takes half the time.
    """
    camera = hypothesis.cameras[0].resized(_SIZE, _SIZE)
    with torch.inference_mode(), autocast(model.device):
        seen = render_exact(model, hypothesis.codes, replace(camera, focal=_CLOSER * camera.focal), _SAMPLES)
    image = (seen.colour.float().clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()
    depth, opacity = seen.depth.float().cpu().numpy(), seen.opacity.float().cpu().numpy()
    return Frame(image, depth, opacity, 0, 1, _SAMPLES, 0.0)
