"""Fitting (Eq. 5): from pictures of an object to its codes and, where unknown, its cameras.

Many hypotheses are raced: each is a camera per picture and a pair of codes, all of them one batch of one network
call. The codes enter as biases, so hypotheses cost what their points cost. They start from the bank of
:mod:`core.starts`, are cut by successive halving, and the front/back twin of the leader is kept to the last round.
The paper's own recipe is the same loop with a single hypothesis: ``PRESETS["paper"]``.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from core.camera import Camera
from core.codes import Codes
from core.confidence import confidence
from core.hypotheses import (
    Numbers,
    Objective,
    Pool,
    Rates,
    advanced,
    cameras,
    codes,
    joined,
    judged,
    rival_of,
    spread_out,
    twin_of,
    twins,
)
from core.metrics import psnr_of
from core.model import Model
from core.photos import Photo
from core.starts import bank_of, ranked
from core.targets import Drawn, Target, draw


@dataclass(frozen=True)
class FitSettings:
    """Every field is an axis of the charts."""

    starts: int = 24
    """cameras to begin from, for every picture whose camera is unknown"""
    steps: int = 200
    rays: int = 384
    """per picture and step for the last hypotheses; the many in the beginning share them out"""
    samples: int = 64
    """along a ray"""
    prior: float = 1e-4
    """of a squared standard deviation of a code, against the squared error of a pixel (Eq. 5's 1 / nu^2)"""
    paper: bool = False
    """one random start without bank or race, mean codes, plain Eq. 5, AdamW at the authors' rates; in any number of
    starts but one there is nothing of the paper's"""

    def __post_init__(self) -> None:
        if min(self.starts, self.steps, self.rays) < 1 or self.samples < 2 or not 0 <= self.prior < math.inf:
            raise ValueError(f"no fit has these settings: {self}")
        if self.paper and self.starts != 1:
            raise ValueError(f"the paper's recipe has one start, got {self.starts}")


PRESETS = {
    "draft": FitSettings(starts=8, steps=80, rays=256),
    "normal": FitSettings(),
    "fine": FitSettings(starts=32, steps=320, rays=768),
    # Section 3.3 says 299 steps and 64 samples. The authors take all pixels at every step; so many of them give the
    # same slopes on average.
    "paper": FitSettings(starts=1, steps=299, rays=512, samples=64, paper=True),
}
"""By what they cost, and the paper's."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What might be the case. A fit can go on from one."""

    start: int
    """which starting camera it came from"""
    loss: float
    cameras: tuple[Camera, ...]
    """one per photo, at the photo's size"""
    codes: Codes
    shift: Float[Tensor, "views 2"]
    """of the optical axes in the pictures, x right and y down, in focal lengths; 0 unless a picture was reframed"""


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
        if self.begin and (len(self.begin.cameras) != len(self.photos) or self.settings.paper):
            raise ValueError("a fit goes on with the pictures it had, and not in the paper's recipe")


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
    alternative: Alternative | None = None
    """from the first measurement on, where one camera is searched for, and not in the paper's recipe"""
    margin: float | None = None
    """logarithm of the alternative's loss over the result's; comes with the alternative, but
    where a fit went on from a given hypothesis"""
    race: tuple[Hypothesis, ...] = ()
    """those that have not diverged, the least loss first; the rival of the last stage among them. The pictures are
    those of the race: where several cameras are unknown, each has one of its own before they meet."""

    @property
    def confidence(self) -> float | None:
        """The probability that the cameras are right, 0..1; None where that is not known."""
        return None if self.margin is None else confidence(self.margin)


def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
    """Find codes and unknown cameras: a FitStep per iteration, the last one being the best found.

    The model stays as it is; the same seed gives the same steps; to stop, ask for no more. Raises ``ValueError``
    where a picture shows nothing, or where every hypothesis diverged.
    """
    began, whole = time.perf_counter(), _Race.of(model, job)
    parts = whole.parts(job)
    steps = whole.steps + sum(part.race.steps for part in parts)
    done, found, finalists = 0, list(whole.given), []
    for part in parts:
        for standing in part.race.run(part.race.entered()):
            done += 1
            step = part.race.reported(standing, done, steps, began)
            for view, camera in zip(part.views, step.cameras, strict=True):
                found[view] = camera
            yield replace(step, cameras=tuple(found))
        finalists.append((part.views, standing.pool))
    for standing in whole.run(whole.combined(finalists) if finalists else whole.entered()):
        done += 1
        yield whole.reported(standing, done, steps, began)


_EVERY = 10
"""Steps between two measurements of the last hypotheses on more rays."""
_RIVAL_SHARE = 3
"""The rival in the last stage gets one of so many rays: it is there to be compared, and seldom wins."""
_LEAST = 1e-6
"""An objective below this counts as this: nobody tells a perfect picture from a more perfect one."""
_MEASURED_RAYS = 2048
"""per picture, always the same ones"""
_RATES = {"angles": 0.03, "distance": 0.012, "shift": 0.003, "shape": 0.08, "texture": 0.08}
"""Adam's, in the beginning; rad, logarithm, focal lengths, standard deviations"""
_RATE_LEFT = 0.04
"""of them at the end"""
_GOING_ON = 0.6
"""How far the rates have already fallen, as a share of the steps, where a fit goes on."""
_LIKENESS = 0.6
"""How much of the shape of its likeness in the bank a hypothesis begins with, the rest being the mean shape."""
_PAPER_RATES = {"angles": 0.1, "distance": 0.01, "codes": 0.01}
"""AdamW's in section 3.3; rad, scene units, numbers of a code"""
_PAPER_HALVED_EVERY = 50
"""steps, in the authors' code"""
_SIZES = 0.25
"""How much the logarithm of an object's apparent size differs from that of its likeness in the bank."""


class _Stage(NamedTuple):
    """A part of the race."""

    hypotheses: int
    """as many as enter it"""
    steps: int
    rays: int
    samples: int
    rank: int
    """of the codes: how many principal directions may move"""
    last: bool = False


def _plan(settings: FitSettings, racing: bool) -> tuple[_Stage, ...]:
    """Successive halving over two fifths of the steps, then the best of six basins, of three, and the best alone."""
    whole = 10_000
    if not racing:
        return (_Stage(1, settings.steps, settings.rays, settings.samples, whole, last=True),)
    counts = [settings.starts]
    while counts[-1] > 8:
        counts.append(counts[-1] // 2)
    steps, rank, plan = max(1, round(0.4 * settings.steps / len(counts))), 8, []
    for count in counts:
        rays = min(settings.rays, max(64, settings.rays * 2 // count))
        plan.append(_Stage(count, steps, rays, max(2, settings.samples * 3 // 4), rank))
        rank *= 2
    left = max(3, settings.steps - steps * len(counts))
    plan.append(_Stage(min(6, settings.starts), left // 3, settings.rays // 2, settings.samples, 32))
    plan.append(_Stage(min(3, settings.starts), left // 3, settings.rays, settings.samples, 64))
    plan.append(_Stage(1, left - 2 * (left // 3), settings.rays, settings.samples, whole, last=True))
    return tuple(plan)


class _Standing(NamedTuple):
    """Where a race stands."""

    pool: Pool
    rival: Pool | None = None
    """the best hypothesis of another basin, once measured"""
    margin: float = 0.0
    """logarithm of its objective over that of the best one"""


class _Part(NamedTuple):
    """The race of one unknown picture, together with the known ones."""

    views: list[int]
    """which pictures of the job these are"""
    race: "_Race"


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
    """the rays that hypotheses are measured on"""
    begin: Hypothesis | None = None
    """where a single hypothesis goes on from"""

    @classmethod
    def of(cls, model: Model, job: FitJob) -> "_Race":
        """Raises ``ValueError`` where a picture shows no object."""
        generator = torch.Generator().manual_seed(job.seed)
        targets = tuple(Target.of(photo, model) for photo in job.photos)
        given = tuple(photo.camera or _nominal(photo, model) for photo in job.photos)
        unknown = torch.tensor([photo.camera is None for photo in job.photos])
        plan = _plan(job.settings, bool(unknown.any()) and not job.settings.paper and not job.begin)
        measure = draw(targets, _MEASURED_RAYS, generator)
        return cls(model, job.settings, job.photos, targets, given, unknown, plan, generator, measure, job.begin)

    @property
    def steps(self) -> int:
        """How many there will be."""
        return sum(stage.steps for stage in self.plan)

    def parts(self, job: FitJob) -> list[_Part]:
        """Where several cameras are unknown: a race for each, which ends where its last few hypotheses remain."""
        unknown = [view for view, photo in enumerate(job.photos) if photo.camera is None]
        if len(unknown) < 2 or self.settings.paper or self.begin:
            return []
        known = [view for view in range(len(job.photos)) if view not in unknown]
        parts = []
        for view in unknown:
            views = [*known, view]
            race = _Race.of(self.model, replace(job, photos=tuple(job.photos[view] for view in views)))
            parts.append(_Part(views, replace(race, plan=race.plan[:-2])))
        return parts

    @property
    def by(self) -> Objective:
        """What hypotheses are judged by."""
        return Objective(self.settings.prior, self.settings.paper)

    def entered(self) -> Pool:
        """The hypotheses at the start line: the cameras of the bank, with shapes towards those of its objects."""
        if self.settings.paper:
            return self._entered_as_in_the_paper()
        if self.begin:
            return self._entered_where(self.begin)
        count, views = self.plan[0].hypotheses, len(self.given)
        angles, distance = torch.zeros(count, views, 2), torch.zeros(count, views)
        ranks = (len(space.spread) for space in (self.model.codes.shape_space, self.model.codes.texture_space))
        alike, texture = (torch.zeros(count, rank) for rank in ranks)
        for view, (photo, camera) in enumerate(zip(self.photos, self.given, strict=True)):
            angles[:, view] = torch.tensor([camera.azimuth, camera.elevation])
            distance[:, view] = math.log(camera.distance / self.model.distance)
            if self.unknown[view]:
                bank = bank_of(self.model)
                starts = ranked(bank, self.model, photo.pixels, photo.mask, camera.focal, count, photo.framed)
                angles[:, view] = torch.stack((starts.azimuth, starts.elevation), -1)
                away = (starts.distance / self.model.distance).log()
                # Objects differ in size too: only what that does not explain is put down to the distance.
                distance[:, view] = away - away.clamp(-_SIZES, _SIZES)
                space = self.model.codes.shape_space
                alike += space.coordinates(bank.codes.shape)[starts.prototype] / int(self.unknown.sum())
        return Pool.of(Numbers(angles, distance, torch.zeros_like(angles), _LIKENESS * alike, texture))

    def _entered_as_in_the_paper(self) -> Pool:
        """One hypothesis: the mean codes, and unknown cameras anywhere on the upper half at the usual distance."""
        known = torch.tensor([(camera.azimuth, camera.elevation) for camera in self.given])
        anywhere = torch.rand(len(self.given), 2, generator=self.generator)
        anywhere = torch.stack((2 * math.pi * anywhere[:, 0], anywhere[:, 1].asin()), -1)
        angles = torch.where(self.unknown[:, None], anywhere, known)[None]
        away = torch.tensor([[math.log(camera.distance / self.model.distance) for camera in self.given]])
        mean = self.model.codes.mean
        return Pool.of(Numbers(angles, away, torch.zeros_like(angles), mean.shape[None], mean.texture[None]))

    def _entered_where(self, begin: Hypothesis) -> Pool:
        """One hypothesis, where an earlier fit left it; known cameras are those of the pictures."""
        at = [photo.camera or camera for photo, camera in zip(self.photos, begin.cameras, strict=True)]
        angles = torch.tensor([[(camera.azimuth, camera.elevation) for camera in at]])
        away = torch.tensor([[math.log(camera.distance / self.model.distance) for camera in at]])
        shapes, textures = self.by.spaces(self.model)
        shape, texture = shapes.coordinates(begin.codes.shape), textures.coordinates(begin.codes.texture)
        pool = Pool.of(Numbers(angles, away, begin.shift[None], shape[None], texture[None]))
        return replace(pool, start=torch.tensor([begin.start]))

    def combined(self, finalists: Sequence[tuple[list[int], Pool]]) -> Pool:
        """Hypotheses of all pictures, from those of the single ones: the cheapest combinations."""
        count = self.plan[0].hypotheses
        combinations: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
        for _, pool in finalists:
            costs = enumerate(pool.cost.tolist())
            longer = [(cost + more, (*taken, index)) for index, more in costs for cost, taken in combinations]
            combinations = sorted(longer)[:count]
        return Pool.of(self._merged(finalists, torch.tensor([taken for _, taken in combinations])))

    def _merged(self, finalists: Sequence[tuple[list[int], Pool]], taken: Int[Tensor, "some parts"]) -> Numbers:
        """The cameras of the finalists, and the mean of the codes they came with."""
        pairs = list(zip(finalists, taken.unbind(1), strict=True))
        chosen = [Numbers(*(part[index] for part in pool.numbers)) for (_, pool), index in pairs]
        blank = torch.zeros(len(taken), len(self.given), 2)
        angles, distance, shift = blank, blank[..., 0].clone(), blank.clone()
        for (views, _), numbers in zip(finalists, chosen, strict=True):
            angles[:, views], distance[:, views], shift[:, views] = numbers.angles, numbers.distance, numbers.shift
        shape = torch.stack([numbers.shape for numbers in chosen]).mean(0)
        return Numbers(angles, distance, shift, shape, torch.stack([numbers.texture for numbers in chosen]).mean(0))

    def run(self, pool: Pool) -> Iterator[_Standing]:
        """Where the race stands after every step; in the end its pool is the best hypothesis that was measured."""
        done = 0
        for stage in self.plan:
            if stage.last:
                yield from self._finished(pool, stage, done)
                return
            pool = self.cut(pool, stage)
            for _ in range(stage.steps):
                pool, done = self.stepped(pool, stage, done / self.steps), done + 1
                yield _Standing(pool)

    def _finished(self, pool: Pool, stage: _Stage, done: int) -> Iterator[_Standing]:
        """The last stage: the leader with all rays and its rival with a few; whichever is better leads on."""
        racing = bool(self.unknown.any()) and not self.settings.paper
        rival = rival_of(pool, pool, self.unknown) if racing else None
        pool, best, standing = self.cut(pool, stage), None, _Standing(pool)
        fewer = stage._replace(rays=max(1, stage.rays // _RIVAL_SHARE))
        for step in range(stage.steps):
            pool = self.stepped(pool, stage, (done + step) / self.steps)
            rival = rival and self.stepped(rival, fewer, (done + step) / self.steps)
            if (step + 1) % _EVERY == 0 or step + 1 == stage.steps:
                pool, rival = self._compared(pool, rival)
                best = pool if best is None or float(pool.cost) < float(best.cost) else best
                standing = self._standing(pool, best, rival)
            yield standing._replace(pool=best if best and step + 1 == stage.steps else pool)

    def _standing(self, pool: Pool, best: Pool, rival: Pool | None) -> _Standing:
        """With what stands against the best: whichever of the two that still run is in another basin than it is."""
        other = rival_of(best, joined(pool, rival), self.unknown) if rival else None
        if other is None or not int(other.age):
            return _Standing(pool)
        return _Standing(pool, other, math.log(max(float(other.cost), _LEAST) / max(float(best.cost), _LEAST)))

    def _compared(self, pool: Pool, rival: Pool | None) -> tuple[Pool, Pool | None]:
        """Both measured, the better one first; where they have met in one basin, its twin is the new rival."""
        if rival is None:
            return self.measured(pool), None
        first, second = sorted((self.measured(pool), self.measured(rival)), key=lambda one: float(one.cost))
        other = rival_of(first, second, self.unknown)
        return first, other if int(other.age) else self.measured(other)

    def cut(self, pool: Pool, stage: _Stage) -> Pool:
        """The best go on, one from each basin first; the leader's twin is set up again where it is lost."""
        if len(pool) <= stage.hypotheses:
            return pool
        leader, kept = pool.leader, spread_out(pool, self.unknown)[: stage.hypotheses]
        behind = twins(pool, leader, self.unknown)
        if stage.hypotheses < 3 or bool(behind[kept].any()):
            return pool[kept]
        return joined(pool[kept[:-1]], twin_of(pool, leader, self.unknown))

    def stepped(self, pool: Pool, stage: _Stage, progress: float) -> Pool:
        """One step for all hypotheses."""
        drawn = draw(self.targets, stage.rays, self.generator)
        jitter = torch.rand(drawn.opaque.shape, generator=self.generator) - 0.5
        rates = self._paper_rates(progress) if self.settings.paper else self._rates(stage, progress)
        return advanced(self.model, pool, drawn, stage.samples, self.by, rates, jitter)

    def measured(self, pool: Pool) -> Pool:
        """The best hypothesis on the rays kept for measuring; of infinite cost where all have diverged."""
        with torch.no_grad():
            found = judged(self.model, pool.numbers, self.measure, self.settings.samples, self.by)
        pool = replace(pool, cost=found.objective.nan_to_num(math.inf, math.inf), squared=found.squared)
        return pool[pool.cost.argmin()[None]]

    def reported(self, standing: _Standing, step: int, steps: int, began: float) -> FitStep:
        """The leader, as the stream shows it."""
        pool, rival = standing.pool, standing.rival
        leader = pool.leader
        shown = FitStep(
            step,
            steps,
            int(pool.start[leader]),
            float(pool.cost[leader]),
            psnr_of(float(pool.squared[leader])),
            time.perf_counter() - began,
            cameras(self.model, pool.numbers, leader, self.given),
            codes(self.model, pool.numbers, leader, self.by),
            len(pool),
            race=self._ranked(pool if rival is None else joined(pool, rival)),
        )
        if rival is None or not math.isfinite(standing.margin) or int(self.unknown.sum()) > 1:
            return shown
        alternative = Alternative(cameras(self.model, rival.numbers, 0, self.given), float(rival.cost))
        # Without a race the alternative had no chance, so its margin says nothing.
        return replace(shown, alternative=alternative, margin=None if self.begin else standing.margin)

    def _ranked(self, pool: Pool) -> tuple[Hypothesis, ...]:
        """A pool's hypotheses, the least cost first, without those that have diverged."""
        shapes, textures = (
            space.code(part).unbind() for space, part in zip(self.by.spaces(self.model), pool.numbers[-2:], strict=True)
        )
        starts, costs = pool.start.tolist(), pool.cost.tolist()
        return tuple(
            Hypothesis(
                starts[index],
                costs[index],
                cameras(self.model, pool.numbers, index, self.given),
                Codes(shapes[index], textures[index]),
                pool.numbers.shift[index],
            )
            for index in pool.cost.argsort(stable=True).tolist()
            if math.isfinite(costs[index])
        )

    def _rates(self, stage: _Stage, progress: float) -> Rates:
        if self.begin:
            progress = _GOING_ON + (1 - _GOING_ON) * progress
        left = _RATE_LEFT + (1 - _RATE_LEFT) * (0.5 + 0.5 * math.cos(math.pi * progress))
        free = self.unknown.float() * left
        framed = torch.tensor([photo.framed for photo in self.photos]).float() * free
        book = self.model.codes
        shape, texture = (
            (torch.arange(len(space.spread)) < stage.rank).float() * left
            for space in (book.shape_space, book.texture_space)
        )
        return Rates(
            _RATES["angles"] * free[:, None],
            _RATES["distance"] * free,
            _RATES["shift"] * framed[:, None],
            _RATES["shape"] * shape,
            _RATES["texture"] * texture,
        )

    def _paper_rates(self, progress: float) -> Rates:
        left = 0.5 ** (round(progress * self.steps) // _PAPER_HALVED_EVERY)
        free = self.unknown.float() * left
        book = self.model.codes
        return Rates(
            _PAPER_RATES["angles"] * free[:, None],
            _PAPER_RATES["distance"] / self.model.distance * free,
            0 * free[:, None],
            _PAPER_RATES["codes"] * left * torch.ones(book.shapes.shape[-1]),
            _PAPER_RATES["codes"] * left * torch.ones(book.textures.shape[-1]),
        )


def _nominal(photo: Photo, model: Model) -> Camera:
    height, width = photo.mask.shape
    return Camera(0.0, 0.0, model.distance, model.focal * height / model.image_size, width, height)
