"""The output of a fit: a stream of steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.fitting.biases import hypothesis_codes
from core.fitting.confidence import confidence, plausible
from core.fitting.hypotheses import Hypothesis, HypothesisBatch, to_cameras, to_hypotheses
from core.fitting.problem import Problem
from core.fitting.search import SearchResult
from core.geometry.camera import Camera
from core.metrics import psnr_from_mse
from core.models.latents import Latents
from core.models.model import Instance


class RunnerUp(NamedTuple):
    """The best hypothesis outside the result's basin, mostly the opposite view."""

    cameras: tuple[Camera, ...]
    loss: float  # on the same pixels as the result's


@dataclass(frozen=True, eq=False)
class FitStep:
    """The state of a fit after a step, with its leading hypothesis. The last step holds the result."""

    step: int
    steps: int  # expected total; a restart raises it
    origin: int  # number of the initial hypothesis it comes from
    loss: float  # for ranking: the objective of some rays, smoothed over steps and weighted by the viewpoint classifier
    psnr: float
    """dB over whole photos, estimated from the step's rays; the restart down-weights possibly occluded pixels"""
    seconds: float  # since the job began
    cameras: tuple[Camera, ...]  # one per photo, at the photo's size
    instance: Instance
    active: int = 1  # number of optimised hypotheses
    restart: bool = False  # part of a later search, after an earlier one left its camera in doubt
    search_psnr: float | None = None
    """dB of the codes alone, in the free stage: by these, as free biases explain photos from any camera"""
    runner_up: RunnerUp | None = None  # at the end of a search for a camera; never in the paper's recipe
    margin: float | None = None
    """Log ratio of the runner-up's loss to the leader's on the same pixels; after two agreeing searches, the smaller
    of the two. None without runner-up, and in a resumed fit."""
    uncertainty: float | None = None  # degrees, of the camera within its basin; at the end of a search with runner-up
    hypotheses: tuple[Hypothesis, ...] = ()
    """The leader, then the others by loss, without diverged ones. While each of several unknown cameras has a search of
    its own, they are for the photos of that search."""

    category_likelihood: float = 1.0  # probability that the photos show the model's category
    mask_confidence: float = 1.0  # probability that a mask is right, geometric mean over the photos
    view_margins: tuple[float | None, ...] = ()  # of the cameras of several photos, for constant codes
    left_out: tuple[int, ...] = ()  # numbers of photos that show another object; their cameras mean nothing
    witness: float = 0.0  # change of the camera's log-odds by a chair's 3D box (:func:`witness_odds`)

    @property
    def is_free(self) -> bool:
        """True in the free stage (:mod:`core.fitting.free`)."""
        return self.search_psnr is not None

    @property
    def confidence(self) -> float | None:
        """Probability that the camera is right, 0..1; None without margin or uncertainty."""
        if self.margin is None or self.uncertainty is None:
            return None
        return self._confidence(self.margin, self.uncertainty)

    @property
    def confidences(self) -> tuple[float | None, ...]:
        """Probability that each photo's camera is right, 0..1; None where it is known, left out or not assessed."""
        if self.margin is None or self.uncertainty is None or not self.view_margins:
            return (self.confidence,) * len(self.cameras)
        return tuple(
            None if margin is None else self._confidence(min(margin, self.margin), self.uncertainty)
            for margin in self.view_margins
        )

    def _confidence(self, margin: float, uncertainty: float) -> float:
        psnr = self.psnr if self.search_psnr is None else self.search_psnr
        plausibility = plausible(self.category_likelihood, self.mask_confidence, psnr)
        return plausibility * confidence(margin, uncertainty, witness=self.witness)


class SearchState(NamedTuple):
    """The state of a search after a step."""

    problem: Problem
    views: Sequence[int]  # photos of the job in this search
    batch: HypothesisBatch  # the optimised hypotheses
    result: SearchResult | None = None  # its winner leads, once it exists
    restart: bool = False  # see FitStep
    remaining: int | None = None  # steps that follow, if they may differ from the schedule
    finished: bool = False  # the result is complete; another search may follow
    freed: HypothesisBatch | None = None  # the result with free biases, in the free stage
    origin: Latents | None = None  # the codes whose biases are free

    @property
    def left_out(self) -> tuple[int, ...]:
        """Numbers of the job's photos that show another object."""
        included = self.problem.included.tolist()
        return tuple(view for view, used in zip(self.views, included, strict=True) if not used)

    def to_step(self, step: int, steps: int, seconds: float) -> FitStep:
        """Return this state as a step of the stream.

        Args:
            step, steps, seconds: see :class:`FitStep`.
        """
        searched = self.result.winner if self.result else self.batch.best
        leading = searched if self.freed is None else self.freed
        hypotheses = self._ranked()
        leader = hypotheses[0]
        runner_up = self.result and self.result.runner_up
        fit_step = FitStep(
            step,
            steps,
            leader.origin,
            leader.loss,
            psnr_from_mse(float(leading.squared_error)),
            seconds,
            leader.cameras,
            leader.instance,
            len(self.batch),
            self.restart,
            hypotheses=hypotheses,
            left_out=self.left_out,
            view_margins=self.result.view_margins if self.result else (),
        )
        if self.freed is not None:
            fit_step = replace(fit_step, search_psnr=psnr_from_mse(float(searched.squared_error)))
        if not (self.result and math.isfinite(self.result.margin)):
            return fit_step
        if runner_up:
            cameras = to_cameras(self.problem.model, runner_up.parameters, 0, self.problem.cameras)
            fit_step = replace(fit_step, runner_up=RunnerUp(cameras, float(runner_up.loss)))
        return replace(fit_step, margin=self.result.margin, uncertainty=self.result.uncertainty)

    def _ranked(self) -> tuple[Hypothesis, ...]:
        """Return the leader, then the others, as :attr:`FitStep.hypotheses`."""
        problem = self.problem
        result = self.result

        def to_all(batch: HypothesisBatch, origin: Latents | None = None) -> tuple[Hypothesis, ...]:
            codes = hypothesis_codes(problem.model, batch.parameters, problem.spaces, origin)
            return to_hypotheses(problem.shown_model, batch, problem.cameras, codes)

        freed = () if self.freed is None else to_all(self.freed, self.origin)
        batches = [self.batch]
        if result and self.batch is result.winner:
            batches = [] if freed else [self.batch]
            batches += [] if result.runner_up is None else [result.runner_up]
        elif result:
            batches = [result.winner, self.batch]
        return *freed, *(hypothesis for batch in batches for hypothesis in to_all(batch))
