"""The settings of a fit, its presets, and its components for ablations."""

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class FitSettings:
    """The budget of a fit. Raises ``ValueError`` for unusable values."""

    hypotheses: int = 28
    """Initial cameras for every photo without a camera, limited by the view bank. Also an upper limit of hypotheses in
    the local search, and of shapes if all cameras are known."""
    steps: int = 56  # of all stages but the coarse search
    rays: int = 1024  # per photo and step of the refinement; earlier stages with many hypotheses use fewer
    samples: int = 64
    """Intervals along a ray in the refinement, for a box with sides of one scene unit; smaller boxes and earlier stages
    have fewer."""
    code_prior: float = 1e-5
    """weight of a code's squared standard deviations, relative to a pixel's squared error (Eq. 5's 1 / nu^2)"""
    free_steps: int = 20  # with free biases, after the search (:mod:`core.fitting.free`); 0: codes alone
    max_restarts: int = 1  # further searches while the single unknown camera is in doubt; the best result is kept
    estimate_focal: bool = False
    """search the focal length of unknown cameras too, with 1.5 times the hypotheses; else use the model's, but where
    several crops tell it (:attr:`core.fitting.problem.FitJob.tells_focal`)"""

    def __post_init__(self) -> None:
        counts = min(self.hypotheses, self.steps, self.rays, self.samples - 1, self.max_restarts + 1)
        if counts < 1 or self.free_steps < 0 or not 0 <= self.code_prior < math.inf:
            raise ValueError(f"no fit has these settings: {self}")

    def for_box(self, extent: tuple[float, float, float]) -> "FitSettings":
        """Return the settings with the number of samples for the mean chord of a box of half size ``extent``."""
        x, y, z = (2 * half for half in extent)
        chord = 3 * x * y * z / (x * y + y * z + z * x)  # relative to a unit cube's
        return replace(self, samples=max(2, round(self.samples * chord)))

    def for_anchor(self) -> "FitSettings":
        """Return the settings of one of several photos alone: half as many steps and rays place the others as well."""
        return replace(self, steps=max(1, self.steps // 2), rays=max(1, self.rays // 2))


@dataclass(frozen=True)
class PaperSettings(FitSettings):
    """The paper's own recipe (:mod:`core.fitting.paper`).

    Section 3.3 has 299 steps and 64 samples. The authors use all pixels at every step; 512 random ones give the same
    gradient on average.
    """

    hypotheses: int = 1
    steps: int = 299
    rays: int = 512
    code_prior: float = 1e-4  # of the squared norm of a code
    free_steps: int = 0
    max_restarts: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hypotheses != 1 or self.estimate_focal or self.free_steps:
            raise ValueError("the paper's recipe has one hypothesis, codes alone, and the focal length of the training")


PRESETS: dict[str, FitSettings] = {
    "draft": FitSettings(hypotheses=12, steps=26, rays=512, free_steps=10, max_restarts=0),
    "normal": FitSettings(),
    "fine": FitSettings(hypotheses=40, steps=84, rays=1536),
    "paper": PaperSettings(),
}  # by cost, then the paper's


@dataclass(frozen=True)
class Components:
    """Components of a fit that an ablation can switch off."""

    view_bank: bool = True  # start from the best matching cameras of the view bank, else from random ones
    prototype_shapes: bool = True  # start from the view bank's best matching shapes, else from the mean shape
    viewpoint_classifier: bool = True  # weight cameras by the viewpoint classifier
    fresh_codes: bool = True
    """start the local search around the best cameras with new codes, else continue the coarse hypotheses"""
    robust_loss: bool = True  # Cauchy's loss in the last stages, else squared errors throughout
    mask_loss: bool = True  # include the term of opacity errors
    camera_prior: bool = True  # include the camera prior
    network: bool = True  # free the network if the photos determine it (:mod:`core.fitting.network`)


ALL_COMPONENTS = Components()
