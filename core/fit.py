"""Fitting (Eq. 5): from pictures of an object to its codes and, where unknown, its cameras.

Many hypotheses are raced: each is a camera per picture and a pair of codes, all of them one batch of one network
call. The codes enter as biases, so hypotheses cost what their points cost. They start from the bank of
:mod:`core.starts`, are cut by successive halving, and the front/back twin of the leader is kept to the last round.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import torch
from jaxtyping import Bool
from torch import Tensor

from core.camera import Camera
from core.codes import Codes
from core.hypotheses import Numbers, Pool, Rates, advanced, cameras, codes, joined, judged, twin_of, twins
from core.metrics import psnr_of
from core.model import Model
from core.photos import Photo
from core.starts import bank_of, ranked
from core.targets import Drawn, Target, draw


@dataclass(frozen=True)
class FitSettings:
    """Every field is an axis of the charts."""

    starts: int = 16
    """cameras to begin from, for every picture whose camera is unknown"""
    steps: int = 160
    rays: int = 384
    """per picture and step for the last hypotheses; the many in the beginning share them out"""
    samples: int = 32
    """along a ray"""
    prior: float = 1e-4
    """of a squared standard deviation of a code, against the squared error of a pixel (Eq. 5's 1 / nu^2)"""

    def __post_init__(self) -> None:
        if min(self.starts, self.steps, self.rays) < 1 or self.samples < 2 or not 0 <= self.prior < math.inf:
            raise ValueError(f"no fit has these settings: {self}")


@dataclass(frozen=True)
class FitJob:
    """Pictures of one object, to be fitted."""

    photos: tuple[Photo, ...]
    settings: FitSettings = field(default_factory=FitSettings)
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.photos:
            raise ValueError("there is no picture to fit")


@dataclass(frozen=True, eq=False)
class FitStep:
    """Where a fit stands: the leading hypothesis after a step. The last one is the result."""

    step: int
    steps: int
    """how many there will be, as far as is known"""
    start: int
    """which starting camera it came from"""
    loss: float
    psnr: float
    """dB, of the whole pictures: estimated from the rays of the step, in the last step measured on more of them"""
    seconds: float
    """since the job began"""
    cameras: tuple[Camera, ...]
    """one per photo, at the photo's size"""
    codes: Codes
    hypotheses: int = 1
    """how many are still in the race"""


def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Find codes and unknown cameras: a FitStep per iteration, the last one being the best found.

    The model stays as it is; the same seed gives the same steps; to stop, ask for no more. Raises ``ValueError``
    where a picture shows nothing, or where every hypothesis diverged.
    """
    race = _Race.of(model, job)
    steps = sum(stage.steps for stage in race.plan)
    pool, done = race.entered(), 0
    best: tuple[float, Pool] = (math.inf, pool)
    for stage in race.plan:
        pool = race.cut(pool, stage)
        for _ in range(stage.steps):
            pool, done = race.stepped(pool, stage, done / steps), done + 1
            if done < steps:
                yield race.reported(pool, done, steps)
            if stage.last and (done % _EVERY == 0 or done == steps):
                best = min(best, race.measured(pool), key=lambda pair: pair[0])
    yield race.reported(best[1], done, steps)


_EVERY = 10
"""Steps between two measurements of the last hypotheses on more rays."""
_MEASURED_RAYS = 2048
"""per picture, always the same ones"""
_RATES = {"angles": 0.03, "distance": 0.012, "shift": 0.003, "shape": 0.08, "texture": 0.08}
"""Adam's, in the beginning; rad, logarithm, focal lengths, standard deviations"""
_RATE_LEFT = 0.04
"""of them at the end"""


class _Stage(NamedTuple):
    """A part of the race."""

    hypotheses: int
    """as many as enter it"""
    steps: int
    rays: int
    samples: int
    rank: int
    """of the codes: how many principal directions may move"""
    last: bool


def _plan(settings: FitSettings, racing: bool) -> tuple[_Stage, ...]:
    """Successive halving over two fifths of the steps, then the best and its twin, then the best alone."""
    whole = 10_000
    if not racing:
        return (_Stage(1, settings.steps, settings.rays, settings.samples, whole, True),)
    counts = [settings.starts]
    while counts[-1] > 4:
        counts.append(counts[-1] // 2)
    steps, rank, plan = max(1, round(0.4 * settings.steps / len(counts))), 8, []
    for count in counts:
        rays = max(64, settings.rays * 2 // count)
        plan.append(_Stage(count, steps, min(rays, settings.rays), settings.samples * 3 // 4, rank, False))
        rank = min(2 * rank, whole)
    left = max(2, settings.steps - steps * len(counts))
    plan.append(_Stage(min(2, settings.starts), left // 2, settings.rays, settings.samples, rank, False))
    plan.append(_Stage(1, left - left // 2, settings.rays, settings.samples, whole, True))
    return tuple(plan)


@dataclass(frozen=True, eq=False)
class _Race:
    """All that stays the same during a fit."""

    model: Model
    settings: FitSettings
    photos: tuple[Photo, ...]
    targets: tuple[Target, ...]
    given: tuple[Camera, ...]
    """known cameras, and for unknown ones their size and focal length"""
    unknown: Bool[Tensor, "views"]
    plan: tuple[_Stage, ...]
    generator: torch.Generator
    measure: Drawn
    began: float

    @classmethod
    def of(cls, model: Model, job: FitJob) -> "_Race":
        began = time.perf_counter()
        generator = torch.Generator().manual_seed(job.seed)
        targets = tuple(Target.of(photo, model) for photo in job.photos)
        given = tuple(photo.camera or _nominal(photo, model) for photo in job.photos)
        unknown = torch.tensor([photo.camera is None for photo in job.photos])
        plan = _plan(job.settings, bool(unknown.any()))
        measure = draw(targets, _MEASURED_RAYS, generator)
        return cls(model, job.settings, job.photos, targets, given, unknown, plan, generator, measure, began)

    def entered(self) -> Pool:
        """The hypotheses at the start line."""
        model, count = self.model, self.plan[0].hypotheses
        book, bank = model.codes, bank_of(model)
        angles, distance = torch.zeros(count, len(self.given), 2), torch.zeros(count, len(self.given))
        prototype = torch.zeros(count, dtype=torch.long)
        for view, (photo, camera) in enumerate(zip(self.photos, self.given, strict=True)):
            angles[:, view] = torch.tensor([camera.azimuth, camera.elevation])
            distance[:, view] = math.log(camera.distance / model.distance)
            if self.unknown[view]:
                starts = ranked(bank, model, photo.pixels, photo.mask, camera.focal, count)
                angles[:, view] = torch.stack((starts.azimuth, starts.elevation), -1)
                distance[:, view] = (starts.distance / model.distance).log() * (1 if photo.framed else _KEEP)
                prototype = starts.prototype
        shape = book.shape_space.coordinates(bank.codes.shape)[prototype] * _PROTO
        texture = torch.zeros(count, len(book.texture_space.spread))
        return Pool.of(Numbers(angles, distance, torch.zeros_like(angles), shape, texture))

    def cut(self, pool: Pool, stage: _Stage) -> Pool:
        """The best go on; so does the twin of the leader, and where it is lost, it is set up again."""
        if len(pool) <= stage.hypotheses:
            return pool
        order = pool.cost.argsort()
        order = order[pool.cost[order].isfinite()]
        leader, kept = pool.leader, order[: stage.hypotheses]
        if stage.hypotheses < 2:
            return pool[kept]
        behind = twins(pool, leader, self.unknown)
        if bool(behind[kept].any()):
            return pool[kept]
        other = order[behind[order]][:1]
        if len(other):
            return pool[torch.cat((kept[: stage.hypotheses - 1], other))]
        if stage.hypotheses > 2:
            return joined(pool[kept[: stage.hypotheses - 1]], twin_of(pool, leader, self.unknown))
        return pool[kept]

    def stepped(self, pool: Pool, stage: _Stage, progress: float) -> Pool:
        """One step for all hypotheses."""
        drawn = draw(self.targets, stage.rays, self.generator)
        jitter = torch.rand(drawn.opaque.shape, generator=self.generator) - 0.5
        rates = self._rates(stage, progress)
        return advanced(self.model, pool, drawn, stage.samples, self.settings.prior, rates, jitter)

    def measured(self, pool: Pool) -> tuple[float, Pool]:
        """The best hypothesis on the rays kept for measuring, and its objective there."""
        with torch.no_grad():
            found = judged(self.model, pool.numbers, self.measure, self.settings.samples, self.settings.prior)
        pool = replace(pool, cost=found.objective.nan_to_num(math.inf, math.inf), squared=found.squared)
        leader = pool.leader
        return float(pool.cost[leader]), pool[torch.tensor([leader])]

    def reported(self, pool: Pool, step: int, steps: int) -> FitStep:
        """The leader, as the stream shows it."""
        leader = pool.leader
        return FitStep(
            step,
            steps,
            int(pool.start[leader]),
            float(pool.cost[leader]),
            psnr_of(float(pool.squared[leader])),
            time.perf_counter() - self.began,
            cameras(self.model, pool.numbers, leader, self.given),
            codes(self.model, pool.numbers, leader),
            len(pool),
        )

    def _rates(self, stage: _Stage, progress: float) -> Rates:
        left = _RATE_LEFT + (1 - _RATE_LEFT) * (0.5 + 0.5 * math.cos(math.pi * progress))
        free = self.unknown.float() * left
        framed = torch.tensor([photo.framed for photo in self.photos]).float() * free
        space = self.model.codes
        ranks = [
            (torch.arange(len(cloud.spread)) < stage.rank).float() * left for cloud in (space.shape_space, space.texture_space)
        ]
        return Rates(
            _RATES["angles"] * free[:, None],
            _RATES["distance"] * free,
            _RATES["shift"] * framed[:, None],
            _RATES["shape"] * ranks[0],
            _RATES["texture"] * ranks[1],
        )


_PROTO = 1.0
_KEEP = 1.0


def _nominal(photo: Photo, model: Model) -> Camera:
    height, width = photo.mask.shape
    return Camera(0.0, 0.0, model.distance, model.focal * height / model.image_size, width, height)
