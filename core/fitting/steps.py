"""The output of a fit: a stream of steps."""

from dataclasses import dataclass
from typing import NamedTuple

from core.fitting.confidence import confidence, plausible
from core.fitting.hypotheses import Hypothesis
from core.geometry.camera import Camera
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
        return plausibility * confidence(margin, uncertainty)
