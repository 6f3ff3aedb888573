"""Fitting (Eq. 5): from pictures of an object to its codes and, where unknown, its cameras.

Many hypotheses are raced (:mod:`core.fitting.search`): each is a camera per picture and a pair of codes, all of them
one batch of one network call. The codes enter as biases, so hypotheses cost what their points cost. Where several
cameras are unknown, each has a first heat of its own before they meet. ``PRESETS["paper"]`` is
:mod:`core.fitting.paper`.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from core.fitting.confidence import confidence
from core.fitting.hypotheses import cameras
from core.fitting.initial import combined
from core.fitting.schedule import PRESETS, FitSettings
from core.fitting.search import Hypothesis, Race, Standing
from core.geometry.camera import Camera
from core.metrics import psnr_from_mse
from core.models.codes import Codes
from core.models.model import Model
from core.photos.photo import Photo

__all__ = ["PRESETS", "Alternative", "FitJob", "FitSettings", "FitStep", "Hypothesis", "fit"]


@dataclass(frozen=True)
class FitJob:
    """Pictures of one object, to be fitted."""

    photos: tuple[Photo, ...]
    settings: FitSettings = field(default_factory=FitSettings)
    seed: int = 0
    begin: Hypothesis | None = None
    """go on from here, without a race"""

    def __post_init__(self) -> None:
        if not self.photos:
            raise ValueError("there is no picture to fit")
        if self.begin and len(self.begin.cameras) != len(self.photos):
            raise ValueError("a fit goes on with the pictures it had")


class Alternative(NamedTuple):
    """The best hypothesis of another basin than the result's: mostly its front/back twin."""

    cameras: tuple[Camera, ...]
    loss: float
    """on the same rays as the result's"""


@dataclass(frozen=True, eq=False)
class FitStep:
    """Where a fit stands: the leading hypothesis after a step. The last one is the result."""

    step: int
    steps: int
    """how many there will be, as far as is known"""
    start: int
    """which start it came from"""
    loss: float
    """what hypotheses are ranked by: the objective of its rays, smoothed over steps and weighed with a glance at the
    pictures"""
    psnr: float
    """dB, of the whole pictures: estimated from the rays of the step, in the last stage measured on more of them"""
    seconds: float
    """since the job began"""
    cameras: tuple[Camera, ...]
    """one per photo, at the photo's size"""
    codes: Codes
    hypotheses: int = 1
    """how many are still in the race"""
    again: bool = False
    """another race is run, as the one before has left its camera in doubt"""
    alternative: Alternative | None = None
    """where one camera is searched for, once a race is over and while its winner leads another; not in the paper's
    recipe"""
    margin: float | None = None
    """logarithm of the alternative's loss over the leader's when both had gone equally far: at the end, or where only
    the leader went on (of two races that agree, in the closer one); comes with the alternative, but where a fit went on
    from a given hypothesis"""
    spread: float | None = None
    """degrees that the camera may be off where it is in the right basin; comes with the alternative"""
    directions: tuple[int, int] = (0, 0)
    """how many principal directions of shape and of texture were free to move so far; in the paper's recipe the numbers
    of the codes"""
    race: tuple[Hypothesis, ...] = ()
    """those that have not diverged, the least loss first; behind the winner its rival. The pictures are
    those of the race: where several cameras are unknown, each has one of its own before they meet."""

    @property
    def confidence(self) -> float | None:
        """The probability that the cameras are right, 0..1; None where that is not known."""
        return None if self.margin is None or self.spread is None else confidence(self.margin, self.spread)


def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Find codes and unknown cameras: a FitStep per iteration, the last one being the best found.

    The model stays as it is; the same seed gives the same steps; to stop, ask for no more. Raises ``ValueError``
    where a picture shows nothing, or where every hypothesis diverged.
    """
    began, whole = time.perf_counter(), Race.of(model, job.photos, job.settings, job.seed, job.begin)
    parts = _parts(whole, job)
    steps = whole.steps + sum(part.race.steps for part in parts)
    done, found, finalists = 0, list(whole.given), []
    for part in parts:
        for pool in part.race.descended(part.race.entered(), part.race.plan):
            done += 1
            step = _reported(part.race, Standing(pool), done, steps, began)
            for view, camera in zip(part.views, step.cameras, strict=True):
                found[view] = camera
            yield replace(step, cameras=tuple(found))
        finalists.append((part.views, pool))
    met = combined(finalists, len(job.photos), whole.plan[0].hypotheses) if finalists else whole.entered()
    ended: Standing | None = None
    for left in reversed(range(job.settings.races)):
        for standing in whole.run(met, ended):
            done += 1
            doubtful = left > 0 and whole.doubts(standing)
            steps = done + whole.steps if doubtful else steps
            yield replace(_reported(whole, standing.beside(ended), done, steps, began), again=ended is not None)
        if not doubtful:
            return
        ended = standing


class _Part(NamedTuple):
    """The race of one unknown picture, together with the known ones."""

    views: list[int]
    """which pictures of the job these are"""
    race: Race


def _parts(whole: Race, job: FitJob) -> list[_Part]:
    """Where several cameras are unknown: a first heat for each."""
    unknown = [view for view, photo in enumerate(job.photos) if photo.camera is None]
    if len(unknown) < 2 or job.settings.paper or job.begin:
        return []
    known = [view for view in range(len(job.photos)) if view not in unknown]
    parts = []
    for view in unknown:
        views = [*known, view]
        race = Race.of(whole.model, tuple(job.photos[view] for view in views), job.settings, job.seed)
        parts.append(_Part(views, replace(race, plan=race.heats[0])))
    return parts


def _reported(race: Race, standing: Standing, step: int, steps: int, began: float) -> FitStep:
    """The leader, as the stream shows it."""
    pool, rival = standing.pool, standing.rival
    leader = pool.leader
    first, *others = race.ranked(pool)
    shown = FitStep(
        step,
        steps,
        first.start,
        first.loss,
        psnr_from_mse(float(pool.squared[leader])),
        time.perf_counter() - began,
        first.cameras,
        first.codes,
        len(pool),
        directions=pool.opened,
        race=(first, *others, *(() if rival is None else race.ranked(rival))),
    )
    if rival is None or not math.isfinite(standing.margin) or int(race.unknown.sum()) > 1:
        return shown
    alternative = Alternative(cameras(race.model, rival.numbers, 0, race.given), float(rival.cost))
    # Without a race the alternative had no chance, so its margin says nothing.
    margin = None if race.begin else standing.margin
    return replace(shown, alternative=alternative, margin=margin, spread=standing.spread)
