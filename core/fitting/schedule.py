"""The schedule of a fit: numbers of hypotheses, steps, rays and samples of its stages."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from core.fitting.settings import Components, FitSettings


class Stage(NamedTuple):
    """Steps with a constant number of hypotheses."""

    hypotheses: int  # largest number, to which the stage prunes at its beginning
    steps: int
    rays: int  # per photo and step
    samples: int  # along a ray
    robust_scale: float  # see Objective; infinite while cameras are far off: then large errors lead to the minimum
    damping: float  # relative to the diagonal of the Gauss-Newton Hessian
    codes_move: bool = True  # else cameras alone


class Schedule(NamedTuple):
    """All stages of a search, in order."""

    coarse: tuple[Stage, ...]  # from cameras on all sides; empty if all cameras are known
    local: tuple[Stage, ...]  # around the best cameras of the coarse stages
    final: Stage  # refines the best hypothesis
    rivals: tuple[Stage, ...] = ()  # of the only unknown camera (:mod:`core.fitting.rivals`)
    free: Stage | None = None  # frees its biases (:mod:`core.fitting.free`)
    placing: tuple[Stage, ...] = ()  # of one photo by another's object (:mod:`core.fitting.anchors`)
    single_steps: int = 0  # of fits of single photos, and of placing by their winners and runners-up

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All stages of the codes."""
        return *self.coarse, *self.local, self.final

    @property
    def steps(self) -> int:
        """Number of steps in all stages, as most fits have them."""
        return sum(stage.steps for stage in (*self.stages, *self.rivals)) + self.free_steps + self.single_steps

    @property
    def free_steps(self) -> int:
        """Number of steps with free biases."""
        return self.free.steps if self.free else 0


class _Row(NamedTuple):
    """A stage relative to the settings."""

    keep: float  # fraction of the previous stage's hypotheses
    limit: float  # largest number of hypotheses
    steps: int  # out of _ALL_STEPS
    rays: float  # fraction of the settings' rays
    samples: float  # fraction of the settings' samples
    robust_scale: float
    damping: float


_COARSE = (
    # keep, limit, steps, rays, samples, robust scale, damping (high for few, unreliable rays)
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
_FINAL = _Row(1.0, 1, 24, 1, 1, 0.2, 0.03)
_RIVALS = (
    _Row(1.0, math.inf, 6, 1 / 16, 1 / 2, math.inf, 0.3),
    _Row(1.0, 4, 6, 1 / 8, 3 / 4, math.inf, 0.3),
    _Row(1.0, 2, 8, 1 / 4, 3 / 4, 0.2, 0.1),
)
_PLACING = (
    _Row(1.0, math.inf, 4, 1 / 16, 1 / 2, math.inf, 0.3),
    _Row(1.0, 5, 6, 1 / 8, 3 / 4, math.inf, 0.3),
)
_JOINT = (
    _Row(1.0, math.inf, 8, 1 / 4, 3 / 4, math.inf, 0.3),
    _Row(1.0, 2, 12, 1 / 2, 3 / 4, 0.2, 0.3),
)
_ASSIGNMENTS = 4  # of cameras to several photos that are optimised jointly
_FREE_DAMPING = 1e-3  # the prior steadies steps of free biases already
_ALL_STEPS = sum(row.steps for row in (*_LOCAL, _FINAL))
LOCAL_OFFSETS = (
    ((0.0, 0.0, 4), (1.5, 0.0, 1), (-1.5, 0.0, 1), (0.0, 1.5, 1), (0.0, -1.5, 1), (13.0, 0.0, 2), (-13.0, 0.0, 2)),
    ((0.0, 0.0, 4), (13.0, 0.0, 1), (-13.0, 0.0, 1)),
)
"""Start cameras of the local search around the camera of the best basin, and around that of the next.

Degrees of azimuth and elevation from that camera, and the number of shapes there. Thirteen degrees correct a coarse
search that converged beside the best camera."""
RIVAL_SECTORS = 8  # of azimuth; two rivals start from each but the winner's
LOCAL_HYPOTHESES = sum(shapes for offsets in LOCAL_OFFSETS for *_, shapes in offsets)
"""Number of hypotheses in the local search, if the view bank has enough prototypes."""
_SHAPES = 6  # hypotheses if every camera is known: initial shapes


def build_schedule(
    settings: FitSettings, components: Components, unknown: int, photos: int = 1, added: int | None = None
) -> Schedule:
    """Return the stages of a fit. Photos share the rays of a step.

    Args:
        unknown: number of unknown cameras. One adds a coarse search from many cameras, whose codes are discarded, as
            codes fitted under a wrong camera do not recover, and its rivals. With more, each photo has a search of
            its own before.
        added: number of photos that join a result from which the fit resumes; None: a search. Without any there is only
            the final stage, for all steps: early stages would spoil the hypothesis.
    """
    starts = settings.hypotheses * 3 // 2 if settings.estimate_focal else settings.hypotheses
    shared = replace(settings, rays=max(1, settings.rays // photos))
    (final,) = _stages((_FINAL,), 1, shared, components)
    free = None
    if settings.free_steps:
        free = final._replace(steps=settings.free_steps, damping=_FREE_DAMPING)
    if added == 0:
        return Schedule((), (), final._replace(steps=settings.steps), free=free)
    placing = _stages(_PLACING, starts, settings, components, codes_move=False)
    if added:
        joint = _stages(_JOINT, 1, shared, components)
        (single,) = _stages((_FINAL,), 1, settings.for_anchor(), components)
        single_steps = added * (single.steps - 1 + 2 * sum(stage.steps for stage in placing))
        return Schedule((), joint, final, free=free, placing=placing, single_steps=single_steps)
    if unknown > 1:
        joint = _stages(_JOINT, _ASSIGNMENTS, shared, components)
        alone = build_schedule(settings.for_anchor(), components, 1).steps
        single_steps = unknown * (alone + 2 * (unknown - 1) * sum(stage.steps for stage in placing))
        return Schedule((), joint, final, free=free, placing=placing, single_steps=single_steps)
    count = min(settings.hypotheses, LOCAL_HYPOTHESES if unknown else _SHAPES)
    *local, final = _stages((*_LOCAL, _FINAL), count, shared, components)
    if not unknown:
        return Schedule((), tuple(local), final, free=free)
    coarse = _stages(_COARSE, starts, shared, components)
    rivals = _stages(_RIVALS, 2 * (RIVAL_SECTORS - 1), shared, components)
    return Schedule(coarse, tuple(local), final, rivals, free)


def _stages(
    rows: Sequence[_Row], count: int, settings: FitSettings, components: Components, codes_move: bool = True
) -> tuple[Stage, ...]:
    stages = list[Stage]()
    row_steps = 0
    for row in rows:
        row_steps += row.steps
        count = int(min(math.ceil(count * row.keep), row.limit))
        steps = max(1, round(settings.steps * row_steps / _ALL_STEPS) - sum(stage.steps for stage in stages))
        rays = min(settings.rays, max(32, round(settings.rays * row.rays)))
        samples = max(2, round(settings.samples * row.samples))
        robust_scale = row.robust_scale if components.robust_loss else math.inf
        stages.append(Stage(count, steps, rays, samples, robust_scale, row.damping, codes_move))
    return tuple(stages)
