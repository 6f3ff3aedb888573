"""How a fit spends its steps: how many hypotheses are alive when, and how finely each is rendered."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain, repeat
from typing import NamedTuple

from core.fitting.settings import Components, FitSettings


class Stage(NamedTuple):
    """Some steps between two prunings."""

    hypotheses: int  # kept when it begins
    steps: int
    rays: int  # per photo and step
    samples: int  # along a ray
    robust_scale: float  # as in Objective: while a camera is far off, the largest errors lead on
    damping: float  # of steps, against the diagonal of the Gauss-Newton Hessian


class Schedule(NamedTuple):
    """All stages of a search, in the order they are run."""

    coarse: tuple[Stage, ...]  # from everywhere, to find about where a camera is; none where all are known
    local: tuple[Stage, ...]  # around the best of those cameras
    final: Stage  # refines the best hypothesis

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All of them."""
        return *self.coarse, *self.local, self.final

    @property
    def steps(self) -> int:
        """How many there are at most."""
        return sum(stage.steps for stage in self.stages)


def stage_numbers(stages: Sequence[Stage], first: int = 0) -> Iterator[int]:
    """Yield for each step the number of its stage, from ``first`` on."""
    return chain.from_iterable(repeat(number, stage.steps) for number, stage in enumerate(stages, first))


class _Row(NamedTuple):
    """A stage in shares of the settings, but for its last two values."""

    keep: float  # of the hypotheses of the stage before
    limit: float  # the most hypotheses
    steps: int  # of _ALL_STEPS
    rays: float
    samples: float
    robust_scale: float
    damping: float


_COARSE = (
    # keep, limit, steps, rays, samples, robust scale, damping (high where few rays say little about a step)
    _Row(1.0, math.inf, 6, 1 / 16, 1 / 2, math.inf, 0.3),
    _Row(0.5, math.inf, 6, 3 / 32, 1 / 2, math.inf, 0.3),
    _Row(1.0, 8, 6, 5 / 32, 3 / 4, math.inf, 0.3),
    _Row(1.0, 5, 6, 1 / 4, 3 / 4, math.inf, 0.3),
)
_LOCAL = (
    _Row(1.0, math.inf, 6, 1 / 16, 1 / 2, math.inf, 0.3),
    _Row(0.5, math.inf, 6, 3 / 32, 1 / 2, math.inf, 0.3),
    _Row(1.0, 4, 6, 5 / 32, 3 / 4, math.inf, 0.3),
    _Row(1.0, 3, 6, 1 / 4, 3 / 4, math.inf, 0.3),
    _Row(1.0, 2, 4, 1 / 2, 3 / 4, 0.2, 0.3),
)
_FINAL = _Row(1.0, 1, 48, 1, 1, 0.2, 0.03)
_ALL_STEPS = sum(row.steps for row in (*_LOCAL, _FINAL))
LOCAL_OFFSETS = (
    (
        (0.0, 0.0, 4),
        (1.5, 0.0, 1),
        (-1.5, 0.0, 1),
        (0.0, 1.5, 1),
        (0.0, -1.5, 1),
        (13.0, 0.0, 2),
        (-13.0, 0.0, 2),
    ),
    ((0.0, 0.0, 4), (13.0, 0.0, 1), (-13.0, 0.0, 1)),
)
"""Degrees of azimuth and elevation from the cameras where the local search begins, and how many shapes each comes with:
around the best basin's camera, around the next one's. Thirteen degrees are for a coarse search that has settled beside
its best."""
LOCAL_HYPOTHESES = sum(shapes for offsets in LOCAL_OFFSETS for *_, shapes in offsets)
"""of the local search, where the model has so many shapes"""
_SHAPES = 6  # hypotheses where every camera is known: shapes to begin from


def build_schedule(settings: FitSettings, components: Components, unknown: bool, resumed: bool = False) -> Schedule:
    """The stages of a fit.

    Where a camera is ``unknown``, a coarse search from many cameras comes first. The codes it finds are given up: what
    they have learnt under a wrong camera they do not forget. A ``resumed`` fit has the final stage only, for all its
    steps: what its hypothesis knows must not be lost to early stages.
    """
    coarse: tuple[Stage, ...] = ()
    count = min(settings.hypotheses, _SHAPES)
    if unknown:
        count = min(settings.hypotheses, LOCAL_HYPOTHESES)
        starts = settings.hypotheses * 3 // 2 if settings.estimate_focal else settings.hypotheses
        coarse = _stages(_COARSE, starts, settings, components)
    *local, final = _stages((*_LOCAL, _FINAL), count, settings, components)
    return Schedule((), (), final._replace(steps=settings.steps)) if resumed else Schedule(coarse, tuple(local), final)


def _stages(rows: Sequence[_Row], count: int, settings: FitSettings, components: Components) -> tuple[Stage, ...]:
    stages, before, done = list[Stage](), 0, 0
    for row in rows:
        before += row.steps
        count = int(min(math.ceil(count * row.keep), row.limit))
        steps = max(1, round(settings.steps * before / _ALL_STEPS) - done)
        done += steps
        rays = min(settings.rays, max(32, round(settings.rays * row.rays)))
        samples = max(2, round(settings.samples * row.samples))
        robust_scale = row.robust_scale if components.robust_loss else math.inf
        stages.append(Stage(count, steps, rays, samples, robust_scale, row.damping))
    return tuple(stages)
