"""The race of a fit: hypotheses descend, are cut by successive halving, and begin once more with fresh codes.

They start from the bank of :mod:`core.photos.view_bank`, descend by :mod:`core.fitting.gauss_newton` as
:mod:`core.fitting.schedule` has it, with a look at what :mod:`core.models.viewpoint` thinks of their cameras. The best
of another basin, mostly the front/back twin of the leader, is kept to the end. Where that is too close for the camera
to be trusted, everything is run once more with other dice.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting import paper
from core.fitting.confidence import confidence
from core.fitting.gauss_newton import spread, stride, tried
from core.fitting.hypotheses import (
    CUT_OFF_SPREAD,
    FRAMED_SPREAD,
    STRAY_SPREADS,
    DivergedError,
    Numbers,
    Objective,
    Pool,
    cameras,
    joined,
    judged,
    rival_of,
    spread_out,
    twin_of,
    twins,
)
from core.fitting.initial import entrants, gone_on, renewed
from core.fitting.observations import Drawn, Target, draw
from core.fitting.schedule import FitSettings, Stage, plan
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.models.viewpoint import glanced, surprise
from core.photos.photo import Photo

_PAPER_EVERY = 10
"""Steps between two measurements in the paper's recipe, the best of which is the result."""
_LEAST = 1e-6
"""An objective below this counts as this: nobody tells a perfect picture from a more perfect one."""
_MEASURED_RAYS = 2048
"""per picture, always the same ones"""
_HELD_RAYS = 512
"""per picture, that are not those of the steps: they tell what pays"""
_LEADING = 16
"""principal directions that are never asked whether they pay"""
_PAYS = 0.002
"""Further ones must lower what held rays cost by this share, in the step that they are tried in."""
_BLOCK = 4
"""Steps of the last stage whose mean is measured: one alone follows its own pixels."""
_STILL = 0.01
"""A fit stops where two such means in a row cost not this share less than all that was measured before."""
_CLOSE = 0.3
"""A rival goes on to the end where the logarithm of its objective over the winner's is less than this."""
_DOUBT = 0.92
"""A camera of less confidence is searched for once more; goes with :data:`core.fitting.confidence.CALIBRATION`."""
_TRUST = 0.15
"""What a glance's surprise at a camera counts against the logarithm of its objective; chosen on 15 held-out chairs."""
_NEWS = 0.4
"""What a step's cost counts in the running mean by which hypotheses are cut."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What might be the case. A fit can go on from one."""

    start: int
    """which start it came from"""
    loss: float
    cameras: tuple[Camera, ...]
    """one per photo, at the photo's size"""
    codes: Codes
    shift: Float[Tensor, "views 2"]
    """of the optical axes in the pictures, x right and y down, in focal lengths; 0 unless a picture was reframed"""


class Standing(NamedTuple):
    """Where a race stands."""

    pool: Pool
    rival: Pool | None = None
    """the best hypothesis of another basin, from when only one goes on"""
    margin: float = math.nan
    """logarithm of its objective over that of the best one when both had gone equally far"""
    spread: float | None = None
    """degrees, in the end, where one camera is searched for"""

    def beside(self, before: "Standing | None") -> "Standing":
        """With the winner of an earlier run among the hypotheses: while it leads, what was found out about it holds."""
        if before is None or self.spread is not None:
            return self
        both = joined(self.pool, before.pool)
        return (self if both.leader < len(self.pool) else before)._replace(pool=both)


@dataclass(frozen=True, eq=False)
class Race:
    """All that stays the same during a fit, and the dice: run a second time it goes another way."""

    model: Model
    settings: FitSettings
    photos: tuple[Photo, ...]
    targets: tuple[Target, ...]
    given: tuple[Camera, ...]
    """known cameras, and for unknown ones their size and focal length"""
    unknown: Bool[Tensor, "views"]
    plan: tuple[Stage, ...]
    generator: torch.Generator
    measure: Drawn
    """the rays that hypotheses are measured on"""
    held: tuple[Drawn, Drawn]
    """the rays that code directions are tried on, and those that say what came of it"""
    glances: tuple[Float[Tensor, "directions"] | None, ...]
    """how probable every direction is at a glance, where a camera is unknown and the model can tell"""
    begin: Hypothesis | None = None
    """where a single hypothesis goes on from"""

    @classmethod
    def of(
        cls,
        model: Model,
        photos: tuple[Photo, ...],
        settings: FitSettings,
        seed: int,
        begin: Hypothesis | None = None,
    ) -> "Race":
        """Raises ``ValueError`` where a picture shows no object."""
        generator = torch.Generator().manual_seed(seed)
        targets = tuple(Target.of(photo, model) for photo in photos)
        given = tuple(photo.camera or _nominal(photo, model) for photo in photos)
        unknown = torch.tensor([photo.camera is None for photo in photos])
        stages = plan(settings, bool(unknown.any()))
        if begin:  # there is nothing to race for, and what was found must not be lost to the early stages
            stages = (stages[-1]._replace(hypotheses=1, steps=settings.steps),)
        measure, *held = (draw(targets, count, generator) for count in (_MEASURED_RAYS, _HELD_RAYS, _HELD_RAYS))
        rays = measure, (held[0], held[1])
        glances = tuple(None if settings.paper else _glanced(model, photo) for photo in photos)
        return cls(model, settings, photos, targets, given, unknown, stages, generator, *rays, glances, begin)

    @property
    def steps(self) -> int:
        """How many there will be."""
        return sum(stage.steps for stage in self.plan)

    @property
    def heats(self) -> tuple[tuple[Stage, ...], tuple[Stage, ...]]:
        """The plan in two: a first heat, where a camera is searched for (else none), and what comes after it."""
        second = next((index for index, stage in enumerate(self.plan) if stage.anew), 0)
        return self.plan[:second], self.plan[second:]

    @property
    def by(self) -> Objective:
        """What hypotheses are judged by in the end."""
        spreads = torch.tensor([STRAY_SPREADS]).repeat(len(self.photos), 1)
        spreads[torch.tensor([photo.cropped for photo in self.photos]), 1] = FRAMED_SPREAD
        spreads[torch.tensor([photo.unseen is not None for photo in self.photos]), 1] = CUT_OFF_SPREAD
        spreads[~self.unknown] = math.inf
        return Objective(self.settings.prior, self.settings.paper, spreads, self.plan[-1].forgiving)

    def entered(self) -> Pool:
        """The hypotheses at the start line."""
        if self.begin:
            begin, spaces = self.begin, self.by.spaces(self.model)
            pool = gone_on(self.model, self.photos, self.given, begin.cameras, begin.shift, begin.codes, spaces)
            return replace(pool, start=torch.tensor([begin.start]), opened=(_LEADING, _LEADING))
        if self.settings.paper:
            return paper.entered(self.model, self.given, self.unknown, self.generator)
        return entrants(self.model, self.photos, self.given, self.plan[0].hypotheses, self.settings.lens)

    def run(self, pool: Pool, before: Standing | None = None) -> Iterator[Standing]:
        """Where the race stands after every step; the last one is of the best hypothesis alone, measured.

        Args:
            before: how an earlier run has ended. Its winner may win this one too; it does where this one diverges.
        """
        try:
            for standing in self._run(pool):
                yield standing if before is None or standing.spread is None else self._better(before, standing)
        except DivergedError:
            if before is None:
                raise
            yield before

    def doubts(self, standing: Standing) -> bool:
        """Whether the one unknown camera, at the end of a race, deserves another one."""
        return standing.spread is not None and not self.begin and confidence(standing.margin, standing.spread) < _DOUBT

    def _better(self, one: Standing, other: Standing) -> Standing:
        """Of the ends of two runs. Its margin is the smaller of both where they agree on the camera, else at most that
        over the other.
        """
        best, worse = sorted((one, other), key=lambda ended: float(ended.pool.cost))
        against = self._against(best.pool, worse.pool)
        among = (best, against) if math.isfinite(against.margin) else (best, worse)
        closest = min(among, key=lambda ended: ended.margin)
        return best._replace(rival=closest.rival, margin=closest.margin)

    def _run(self, pool: Pool) -> Iterator[Standing]:
        """Once. The winner of a first heat stands beside the second, as it was: who stops early gets the better one.
        The last stage is the winner's alone, but where its rival is close behind: then both go on to the end.
        """
        if self.settings.paper:
            pool, _ = self._opened(pool, self.plan[0])
            yield from map(Standing, self._descended_as_in_the_paper(pool))
            return
        first, (*racing, last) = self.heats
        began = pool
        for began in self.descended(pool, first):
            yield Standing(began)
        left = entered = renewed(self.model, self.photos, self.given, began, racing[0].hypotheses) if first else began
        for left in self.descended(entered, racing):
            yield Standing(joined(left, began[torch.tensor([began.leader])]) if first else left)
        ended = self._ended(left, began)
        raced = ended.rival if ended.margin < _CLOSE and not self.begin else None  # who goes on with one means that one
        yield from self._finished(ended, joined(ended.pool, raced) if raced else ended.pool, last)

    def _finished(self, ended: Standing, finalists: Pool, stage: Stage) -> Iterator[Standing]:
        """The last stage, which ends where its steps rest; who stops before gets the best measured till then."""
        means, recent = [finalists], list[Pool]()
        stage = stage._replace(hypotheses=len(finalists))
        for step, after in enumerate(self.descended(finalists, (stage,)), 1):
            recent = [*recent, after][-_BLOCK:]
            if step % _BLOCK == 0 or step == stage.steps:
                means.append(self.measured(_mean(recent)))
                costs = [max(float(mean.cost.min()), _LEAST) for mean in means]
                rests = len(means) > 3 and min(costs[-2:]) > (1 - _STILL) * min(costs[:-2])
                if step == stage.steps or (self.settings.sparing and rests):
                    break
            best = min(means, key=lambda mean: float(mean.cost.min()))
            yield Standing(best, ended.rival if len(best) == 1 else None)
        measured = joined(*means)
        winner = measured[torch.tensor([measured.leader])]
        settled = ended._replace(pool=winner) if len(finalists) == 1 else self._against(winner, measured)
        yield settled._replace(spread=self._spread(winner))

    def descended(self, pool: Pool, plan: Sequence[Stage]) -> Iterator[Pool]:
        """What is left of the hypotheses after every step of some stages."""
        for stage in plan:
            pool, stage = self._opened(self.cut(pool, stage), stage)
            for step in range(stage.steps):
                after = stride(self.model, pool, *self._pixels(stage), stage, self._during(stage), self._free)
                after = self._weighed(after)
                smooth = torch.lerp(pool.cost, after.cost, _NEWS if step else 1.0).nan_to_num(math.inf, math.inf)
                pool = replace(after, cost=smooth)
                yield pool

    def _opened(self, pool: Pool, stage: Stage) -> tuple[Pool, Stage]:
        """Both with as many code directions as the stage has; a sparing fit opens further ones of shape, and of
        texture, only where a step of the leader along them lowers what held rays cost.
        """
        numbers, before = pool.numbers, pool.opened
        most = min(stage.ranks[0], numbers.shape.shape[1]), min(stage.ranks[1], numbers.texture.shape[1])
        stage = stage._replace(ranks=most)
        leading = all(had >= min(_LEADING, all_of) for had, all_of in zip(before, most, strict=True))
        few = min(before[0], most[0]), min(before[1], most[1])  # a stage may have fewer than opened before
        if self.settings.sparing and leading and few != most:
            leader = pool[torch.tensor([pool.leader])]
            choices = few, (most[0], few[1]), (few[0], most[1])
            by, (steps, asked) = self._during(stage), self.held
            there = tried(self.model, leader, steps, stage, by, self._free, choices)
            with torch.no_grad():
                found = judged(self.model, there, asked, stage.samples, by._replace(prior=0.0)).objective
            worth = (1 - _PAYS) * float(found[0])
            most = (most[0] if found[1] < worth else few[0]), (most[1] if found[2] < worth else few[1])
        opened = max(before[0], most[0]), max(before[1], most[1])
        return replace(pool, opened=opened), stage._replace(ranks=most)

    def _pixels(self, stage: Stage) -> tuple[Drawn, Tensor]:
        """Some of every picture, and by how much the samples of their rays are moved."""
        drawn = draw(self.targets, stage.rays, self.generator)
        return drawn, torch.rand(drawn.opaque.shape, generator=self.generator) - 0.5

    def _during(self, stage: Stage) -> Objective:
        return self.by._replace(forgiving=stage.forgiving)

    def _descended_as_in_the_paper(self, pool: Pool) -> Iterator[Pool]:
        """The one hypothesis after every step, in the end the best of those that were measured."""
        best = replace(pool, cost=torch.full_like(pool.cost, math.inf))
        steps = paper.descent(self.model, pool, self.targets, self.plan[0], self.by, self.unknown, self.generator)
        for step, after in enumerate(steps, 1):
            if step % _PAPER_EVERY == 0 or step == self.steps:
                best = min(best, self.measured(after), key=lambda one: float(one.cost))
            yield after if step < self.steps else best

    def _ended(self, pool: Pool, began: Pool) -> Standing:
        """The best of what is left, of where that began and of what won there, with what stands against it: mostly
        its twin.
        """
        asked = torch.isin(began.start, pool.start)
        asked[began.leader] = True
        rest = joined(pool, began[asked.nonzero()[:, 0]])
        if bool(self.unknown.any()):
            rest = joined(rest, twin_of(pool, pool.leader, self.unknown))
        # What a first heat opened and the second did not is closed again.
        rest = self.measured(replace(rest, opened=pool.opened))
        best = rest[torch.tensor([rest.leader])]
        return self._against(best, rest) if bool(self.unknown.any()) else Standing(best)

    def _spread(self, pool: Pool) -> float | None:
        """Of the one unknown camera, by rays that are not fitted; in degrees."""
        if int(self.unknown.sum()) != 1:
            return None
        view, stage = int(self.unknown.nonzero()[0, 0]), self.plan[-1]._replace(ranks=pool.opened)
        return math.degrees(spread(self.model, pool, self.held[0], stage, self._during(stage), self._free, view))

    def _against(self, best: Pool, rest: Pool) -> Standing:
        """The best hypothesis, with the best of another basin."""
        rival = rival_of(best, rest, self.unknown)
        return Standing(best, rival, math.log(max(float(rival.cost), _LEAST) / max(float(best.cost), _LEAST)))

    def cut(self, pool: Pool, stage: Stage) -> Pool:
        """The best go on, one from each basin and lens first; the leader's twin is set up again where it is lost."""
        if len(pool) <= stage.hypotheses:
            return pool
        leader, kept = pool.leader, spread_out(pool, self.unknown)[: stage.hypotheses]
        behind = twins(pool, leader, self.unknown)
        if not bool(self.unknown.any()) or stage.hypotheses < 3 or bool(behind[kept].any()):
            return pool[kept]
        return joined(pool[kept[: stage.hypotheses - 1]], twin_of(pool, leader, self.unknown))

    def measured(self, pool: Pool) -> Pool:
        """The hypotheses with what they cost on the rays kept for measuring."""
        with torch.no_grad():
            found = judged(self.model, pool.numbers, self.measure, self.settings.samples, self.by)
        cost = found.objective.nan_to_num(math.inf, math.inf)
        return self._weighed(replace(pool, cost=cost, squared=found.squared))

    def _weighed(self, pool: Pool) -> Pool:
        """With costs that are the higher, the more cameras would surprise who has only glanced at the pictures."""
        odds = torch.zeros(len(pool))
        for probability, angles in zip(self.glances, pool.numbers.angles.unbind(1), strict=True):
            if probability is not None:
                odds += surprise(probability, *angles.unbind(-1))
        return replace(pool, cost=pool.cost * (_TRUST * odds).exp())

    def ranked(self, pool: Pool) -> tuple[Hypothesis, ...]:
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

    @property
    def _free(self) -> Bool[Tensor, "views 6"]:
        """Which numbers of the cameras are searched for: the middle only where a picture was moved."""
        framed = torch.tensor([photo.cropped for photo in self.photos])
        turned, moved = self.unknown[:, None].expand(-1, 3), (self.unknown & framed)[:, None].expand(-1, 2)
        return torch.cat((turned, (self.unknown & self.settings.lens)[:, None], moved), 1)


def _mean(steps: Sequence[Pool]) -> Pool:
    """Where hypotheses were on average over some steps."""
    numbers = (torch.stack(parts).mean(0) for parts in zip(*(step.numbers for step in steps), strict=True))
    return replace(steps[-1], numbers=Numbers(*numbers))


def _glanced(model: Model, photo: Photo) -> Float[Tensor, "directions"] | None:
    return (
        None
        if model.viewpoint_classifier is None or photo.camera
        else glanced(model.viewpoint_classifier, photo.pixels, photo.mask)
    )


def _nominal(photo: Photo, model: Model) -> Camera:
    height, width = photo.mask.shape
    return Camera(0.0, 0.0, model.distance, model.focal * height / model.image_size, width, height)
