"""How a fit spends its steps: how many hypotheses are alive when, and how finely each is looked at."""

import math
from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class FitSettings:
    """Every field is an axis of the charts."""

    starts: int = 28
    """cameras to begin from, for every picture whose camera is unknown, as far as there are so many; also the most
    hypotheses of a second heat, and where all cameras are known of shapes"""
    steps: int = 82
    """of the last heat, at most, and at least six; where a camera is unknown, a first one of a third as many goes
    before it"""
    rays: int = 1024
    """per picture and step for the last hypothesis; the many in the beginning get fewer each"""
    samples: int = 64
    """along a ray for the last hypothesis; the earlier stages, which sort, have fewer"""
    prior: float = 1e-5
    """of a squared standard deviation of a code, against the squared error of a pixel (Eq. 5's 1 / nu^2)"""
    sparing: bool = True
    """open further code directions only where they pay on rays that are not fitted, and stop where steps do not"""
    races: int = 2
    """at most: where the one unknown camera is in doubt after a race, another is run, and the better winner wins"""
    lens: bool = False
    """search for the focal length of unknown cameras too, from half as many starts again; else it is that of the
    training pictures"""
    paper: bool = False
    """one random start without bank or race, mean codes, plain Eq. 5, AdamW at the authors' rates; in any number of
    starts but one there is nothing of the paper's"""

    def __post_init__(self) -> None:
        if (
            min(self.starts, self.steps, self.rays, self.races) < 1
            or self.samples < 2
            or not 0 <= self.prior < math.inf
        ):
            raise ValueError(f"no fit has these settings: {self}")
        if self.paper and (self.starts != 1 or self.lens):
            raise ValueError("the paper's recipe has one start, and the focal length of the training pictures")


PRESETS = {
    "draft": FitSettings(starts=12, steps=38, rays=512, races=1),
    "normal": FitSettings(),
    "fine": FitSettings(starts=40, steps=123, rays=1536),
    # Section 3.3 says 299 steps and 64 samples. The authors take all pixels at every step; so many of them give the
    # same slopes on average.
    "paper": FitSettings(starts=1, steps=299, rays=512, samples=64, prior=1e-4, paper=True),
}
"""By what they cost, and the paper's."""


class Stage(NamedTuple):
    """A part of the race."""

    hypotheses: int
    """as many as enter it"""
    steps: int
    rays: int
    samples: int
    ranks: tuple[int, int]
    """of shape and texture: how many principal directions may move"""
    forgiving: float
    """as in :class:`core.fitting.hypotheses.Objective`: while a camera is far off, it is what is most wrong that leads
    on
    """
    damping: float
    """of steps, against the quadratic's own diagonal"""
    anew: bool = False
    """a second heat begins, with codes that have learnt nothing yet"""


AROUND = (
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
"""degrees by which azimuths and elevations are moved for the second heat, and the shapes that come with each: of the
best basin's cameras, of the next one's. Thirteen degrees are for a first heat that has settled beside its best."""
RENEWED = sum(shapes for around in AROUND for *_, shapes in around)
"""hypotheses in the second heat, where the model has so many shapes"""
_SHAPES = 6
"""hypotheses where every camera is known: shapes to begin from, as far as there are so many starts"""
_FIRST, _SECOND = (math.inf, math.inf, 8, 5), (math.inf, math.inf, 4, 3, 2, 1)
"""hypotheses in each stage of a heat; the second has half of the first's"""
_STEPS = (6, 6, 6, 6, 4, 48)
_RAYS = (1 / 16, 3 / 32, 5 / 32, 1 / 4, 1 / 2, 1)
_SAMPLES = (1 / 2, 1 / 2, 3 / 4, 3 / 4, 3 / 4, 1)
_RANKS = (8, 16, 32, 64, 10_000, 10_000)
_FORGIVING = (math.inf, math.inf, math.inf, math.inf, 0.2, 0.2)
_DAMPING = (0.3, 0.3, 0.3, 0.3, 0.3, 0.03)
"""few rays at first, of which a step should not believe too much"""


def plan(settings: FitSettings, blind: bool) -> tuple[Stage, ...]:
    """The race. In the second heat half of the hypotheses go on after the first stage, then the best of four basins
    (and lenses, where these are searched for), of three, of two; the last stage is the winner's alone.

    Where a camera is unknown (``blind``), a first heat of many starts finds out about where it stands. Its codes are
    given up: what they have learnt under a wrong camera they do not forget. The paper has just one hypothesis.
    """
    if settings.paper:
        ranks = (_RANKS[-1],) * 2
        return (Stage(1, settings.steps, settings.rays, settings.samples, ranks, math.inf, 0.0),)
    if not blind:
        return _heat(settings, min(settings.starts, _SHAPES), _SECOND)
    starts = settings.starts * 3 // 2 if settings.lens else settings.starts
    begin, *rest = _heat(settings, min(settings.starts, RENEWED), _SECOND)
    return (*_heat(settings, starts, _FIRST), begin._replace(anew=True), *rest)


def _heat(settings: FitSettings, count: int, most: tuple[float, ...]) -> tuple[Stage, ...]:
    """As many stages as ``most`` has."""
    stages, done = list[Stage](), 0
    for index, limit in enumerate(most):
        count = int(min(count if index != 1 else -(-count // 2), limit))
        until = round(settings.steps * sum(_STEPS[: index + 1]) / sum(_STEPS))
        steps, rays = max(1, until - done), min(settings.rays, max(32, round(settings.rays * _RAYS[index])))
        samples = max(2, round(settings.samples * _SAMPLES[index]))
        ranks, forgiving = (_RANKS[index],) * 2, _FORGIVING[index]
        stages.append(Stage(count, steps, rays, samples, ranks, forgiving, _DAMPING[index]))
        done += steps
    return tuple(stages)
