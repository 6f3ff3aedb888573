"""The output of a fit: a stream of steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.fitting.confidence import confidence, plausible
from core.fitting.hypotheses import Hypothesis, HypothesisBatch, to_cameras, to_hypotheses
from core.fitting.problem import Problem
from core.fitting.search import SearchResult
from core.geometry.camera import Camera
from core.metrics import psnr_from_mse
from core.models.codes import Codes


class RunnerUp(NamedTuple):
    """The best hypothesis of another basin than the result's: mostly seen from the opposite side."""

    cameras: tuple[Camera, ...]
    loss: float  # on the same pixels as the result's


@dataclass(frozen=True, eq=False)
class FitStep:
    """Where a fit stands: the leading hypothesis after a step. The last one is the result."""

    step: int
    steps: int  # how many there will be, as far as is known
    origin: int  # the number of the initial hypothesis that it comes from
    loss: float
    """what hypotheses are ranked by: the objective of some rays, smoothed over steps and weighed with the viewpoint
    classifier"""
    psnr: float
    """dB over whole photos, estimated from the rays of the step, while the best is refined from more of them; pixels
    behind a suspected occluder are down-weighted in the restart"""
    seconds: float  # since the job began
    cameras: tuple[Camera, ...]  # one per photo, at the photo's size
    codes: Codes
    active: int = 1  # how many hypotheses are optimised
    restart: bool = False  # the search is run once more, as the first one has left its camera in doubt
    runner_up: RunnerUp | None = None
    """where one camera is searched for, once its hypotheses are sorted; not in the paper's recipe"""
    margin: float | None = None
    """logarithm of the runner-up's loss over the leader's when both had been optimised equally long (of two searches
    that agree, in the closer one); comes with the runner-up, but not where a fit resumed from a given hypothesis"""
    uncertainty: float | None = None
    """degrees that the camera may be off where it is in the right basin; comes with the runner-up, in the end"""
    hypotheses: tuple[Hypothesis, ...] = ()
    """the leader, then the others that have not diverged, the least loss first. Where several cameras are unknown, they
    are of the photos of the search under way: each camera has one of its own at first."""

    category_likelihood: float = 1.0  # the probability that the photos show an object of the model's category
    mask_confidence: float = 1.0  # the probability that all masks are the object
    stage: int = 0  # number of the stage of the schedule, counted through all searches of the fit
    witness: float = 0.0  # what the 3D box of a chair adds to the logarithm of the odds of the camera

    @property
    def confidence(self) -> float | None:
        """The probability that the cameras are right, 0..1; None where that is not known."""
        if self.margin is None or self.uncertainty is None:
            return None
        at_all = plausible(self.category_likelihood, self.mask_confidence, self.psnr)
        return at_all * confidence(self.margin, self.uncertainty, witness=self.witness)


class SearchState(NamedTuple):
    """Where a search stands after a step."""

    problem: Problem
    views: Sequence[int]  # which photos of the job are searched with
    stage: int
    batch: HypothesisBatch  # what is optimised
    result: SearchResult | None = None  # whose winner leads, once there is one
    restart: bool = False
    restart_follows: bool = False
    finished: bool = False  # a search has ended, though another may follow

    def to_step(self, step: int, steps: int, seconds: float) -> FitStep:
        """The step of the stream that shows this state."""
        leading = self.result.winner if self.result else self.batch.best
        hypotheses = self._ranked()
        first, runner_up = hypotheses[0], self.result and self.result.runner_up
        shown = FitStep(
            step,
            steps,
            first.origin,
            first.loss,
            psnr_from_mse(float(leading.squared_error)),
            seconds,
            first.cameras,
            first.codes,
            len(self.batch),
            self.restart,
            hypotheses=hypotheses,
            stage=self.stage,
        )
        if not (self.result and runner_up and math.isfinite(self.result.margin) and self.problem.unknown.sum() == 1):
            return shown
        cameras = to_cameras(self.problem.model, runner_up.parameters, 0, self.problem.cameras)
        other = RunnerUp(cameras, float(runner_up.loss))
        return replace(shown, runner_up=other, margin=self.result.margin, uncertainty=self.result.uncertainty)

    def _ranked(self) -> tuple[Hypothesis, ...]:
        """The leader, then the others."""
        result, batch = self.result, self.batch
        batches = [batch]
        if result and batch is result.winner:
            batches = [batch] if result.runner_up is None else [batch, result.runner_up]
        elif result:
            batches = [result.winner, batch]
        problem = self.problem
        return tuple(
            one for some in batches for one in to_hypotheses(problem.model, some, problem.cameras, problem.spaces)
        )
