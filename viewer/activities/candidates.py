"""The candidates of a fit: a tile with a thumbnail per hypothesis of its search."""

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

import torch

from core.fitting.fit import FitStep, Hypothesis
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.models.model import Model
from core.rendering.progressive import Frame
from core.rendering.reference import render_exact
from core.runtime.precision import autocast
from viewer.services.jobs import BACKGROUND_SHARE, Jobs
from viewer.services.worker import Job
from viewer.values.project import SavedTile

_MAX_STEP = 45.0  # degrees that no step turns a camera; beyond, it is another hypothesis of the same origin
_SIZE, _SAMPLES = 32, 16  # px of a thumbnail's side, and samples along a ray
_CLOSER = 1.5  # zoom of thumbnails, as photos have a margin around the object


@dataclass(frozen=True, eq=False)
class Tile:
    """A hypothesis as a tile, followed through the steps of a fit."""

    number: int  # in the order of appearance
    hypothesis: Hypothesis  # as of the last step that had it
    eliminated_at: float | None = None  # s of the fit when it was dropped; None while active
    frame: Frame | None = None  # thumbnail; None until it is rendered


def update_tiles(tiles: Sequence[Tile], step: FitStep) -> tuple[Tile, ...]:
    """Return the tiles after a step: active ones by loss, then eliminated ones, the last eliminated first.

    Hypotheses have no identity: each is matched to the tile of the same origin with the nearest cameras.
    """
    left = [tile for tile in tiles if tile.eliminated_at is None]
    active, fresh = list[Tile](), count(len(tiles))
    for hypothesis in step.hypotheses:
        tile = min(left, key=lambda tile: _angle(tile, hypothesis), default=None)
        if tile is None or _angle(tile, hypothesis) > _MAX_STEP:
            tile = Tile(next(fresh), hypothesis)
        else:
            left.remove(tile)
        active.append(replace(tile, hypothesis=hypothesis))
    eliminated = [replace(tile, eliminated_at=step.seconds) for tile in left]
    return (*active, *eliminated, *(tile for tile in tiles if tile.eliminated_at is not None))


def _angle(tile: Tile, hypothesis: Hypothesis) -> float:
    """Return the largest turn of a camera in degrees; infinite for another origin or number of photos."""
    before, now = tile.hypothesis, hypothesis
    if before.origin != now.origin or len(before.cameras) != len(now.cameras):
        return math.inf
    return max(map(_angle_between, before.cameras, now.cameras))


def _angle_between(first: Camera, second: Camera) -> float:
    """Return the degrees between two cameras' directions. Fast, as it is called many times a frame."""
    cosine = math.sin(first.elevation) * math.sin(second.elevation) + math.cos(first.elevation) * math.cos(
        second.elevation
    ) * math.cos(first.azimuth - second.azimuth)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


class Candidates:
    """The tiles of the current or last fit, re-rendered one by one while it runs."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self.tiles: tuple[Tile, ...] = ()
        self._over = True  # no fit is running

    def close(self) -> None:
        """Stop rendering."""
        self._jobs.cancel("candidates")

    def reset(self, tiles: tuple[Tile, ...] = ()) -> None:
        """Replace the tiles, for another fit."""
        self.close()
        self.tiles = tiles

    def saved(self) -> tuple[SavedTile, ...]:
        """Return the tiles without their thumbnails."""
        return tuple(SavedTile(tile.number, tile.hypothesis, tile.eliminated_at) for tile in self.tiles)

    def restore(self, saved: tuple[SavedTile, ...]) -> None:
        """Show saved tiles; their thumbnails are rendered again."""
        self.reset(tuple(Tile(*tile) for tile in saved))
        self.finish()

    def update(self, step: FitStep) -> None:
        """Update the tiles by a step of the running fit."""
        self.tiles, self._over = update_tiles(self.tiles, step), False
        self._start()

    def finish(self) -> None:
        """End the updates after the fit; render the tiles that have no thumbnail yet."""
        self._over = True
        self._start()

    def _start(self) -> None:
        if self.tiles and not self._jobs.busy("candidates"):
            ended = self._jobs.reporting("Cannot render the candidates")
            self._jobs.submit(Job("candidates", self._render, self._keep, ended, share=BACKGROUND_SHARE))

    def _render(self) -> Iterator[tuple[int, Frame]]:
        """Yield thumbnails by number: alternately the best tile and the least recent one.

        After the fit only missing thumbnails are rendered.
        """
        turns, rendered = count(), dict[int, int]()
        while waiting := [tile for tile in self.tiles if self._is_due(tile, rendered)]:
            turn = next(turns)
            tile = waiting[0] if turn % 2 else min(waiting, key=lambda tile: rendered.get(tile.number, -1))
            rendered[tile.number] = turn
            yield tile.number, _thumbnail(self._jobs.models.of(tile.hypothesis.codes), tile.hypothesis)

    def _is_due(self, tile: Tile, rendered: Container[int]) -> bool:
        if self._over:
            return tile.frame is None and tile.number not in rendered
        return tile.eliminated_at is None

    def _keep(self, rendered: tuple[int, Frame]) -> None:
        number, frame = rendered
        self.tiles = tuple(replace(tile, frame=frame) if tile.number == number else tile for tile in self.tiles)


def _thumbnail(model: Model, hypothesis: Hypothesis) -> Frame:
    """Render a hypothesis coarsely, by the reference renderer: for a new shape it takes half the fast one's time."""
    camera = hypothesis.cameras[0].resized(_SIZE, _SIZE)
    with torch.inference_mode(), autocast(model.device):
        rendered = render_exact(model, hypothesis.codes, replace(camera, focal=_CLOSER * camera.focal), _SAMPLES)
    image = to_bytes(rendered.colour.float())
    depth, opacity = rendered.depth.float().cpu().numpy(), rendered.opacity.float().cpu().numpy()
    return Frame(image, depth, opacity, 0, 1, _SAMPLES, 0.0)
