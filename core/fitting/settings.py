"""The settings of a fit, its presets, and its components for ablations."""

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class FitSettings:
    """The budget of a fit; every field is an axis of the charts. Raises ``ValueError`` where no fit can use it."""

    hypotheses: int = 28
    """cameras to begin from, for every photo whose camera is unknown, as far as the view bank has so many; also the
    most hypotheses of the local search, and where all cameras are known the most shapes"""
    steps: int = 82
    """of the local search and the refinement together, at most, and at least six; where a camera is unknown, a coarse
    search of a third as many comes first"""
    rays: int = 1024  # per photo and step while the best hypothesis is refined; the many before get fewer each
    samples: int = 64
    """along a ray through a box of one scene unit while the best hypothesis is refined; fewer through a smaller box,
    and in the stages before, which sort"""
    code_prior: float = 1e-5
    """of a squared standard deviation of a code, against the squared error of a pixel (Eq. 5's 1 / nu^2)"""
    max_restarts: int = 1
    """searches after the first, each run while the one unknown camera is in doubt; the best result of all is kept"""
    estimate_focal: bool = False
    """search for the focal length of unknown cameras too, from half as many hypotheses again; else it is that of the
    training images"""

    def __post_init__(self) -> None:
        counts = min(self.hypotheses, self.steps, self.rays, self.samples - 1, self.max_restarts + 1)
        if counts < 1 or not 0 <= self.code_prior < math.inf:
            raise ValueError(f"no fit has these settings: {self}")

    def for_box(self, extent: tuple[float, float, float]) -> "FitSettings":
        """Return the settings with equally long intervals in a box of this half size: samples go by its mean chord."""
        x, y, z = (2 * half for half in extent)
        chord = 3 * x * y * z / (x * y + y * z + z * x)  # relative to that of a unit cube
        return replace(self, samples=max(2, round(self.samples * chord)))


@dataclass(frozen=True)
class PaperSettings(FitSettings):
    """The paper's own recipe (:mod:`core.fitting.paper`).

    Section 3.3 says 299 steps and 64 samples. The authors take all pixels at every step; so many of them give the same
    gradient on average.
    """

    hypotheses: int = 1
    steps: int = 299
    rays: int = 512
    code_prior: float = 1e-4  # of the squared norm of a code
    max_restarts: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hypotheses != 1 or self.estimate_focal:
            raise ValueError("the paper's recipe has one hypothesis, and the focal length of the training images")


PRESETS: dict[str, FitSettings] = {
    "draft": FitSettings(hypotheses=12, steps=38, rays=512, max_restarts=0),
    "normal": FitSettings(),
    "fine": FitSettings(hypotheses=40, steps=123, rays=1536),
    "paper": PaperSettings(),
}  # By what they cost, and the paper's.


@dataclass(frozen=True)
class Components:
    """The parts of a fit that an ablation can switch off."""

    view_bank: bool = True  # begin from the cameras of the view bank that match best, else from random ones
    prototype_shapes: bool = True
    """begin from the shapes of the view bank that look most like the photo, else from the mean shape"""
    viewpoint_classifier: bool = True  # weigh cameras by what viewpoint predicts
    distinct_basins: bool = True  # keep the best hypothesis of each basin before a second one of any
    fresh_codes: bool = True
    """begin the local search around the best cameras with fresh codes, else go on with those found so far"""
    early_stopping: bool = True  # end the refinement once further steps no longer improve it
    robust_loss: bool = True  # the last stages use Cauchy's loss, else squared errors throughout
    mask_loss: bool = True
    camera_prior: bool = True


ALL_COMPONENTS = Components()
