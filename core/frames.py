"""The progressive stream of pictures that a viewer shows: coarse at once, fine when the hand rests."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float32, Int32, UInt8

from core.camera import Camera
from core.codes import Codes
from core.march import keeps, march
from core.model import Model


@dataclass(frozen=True)
class RenderSettings:
    """Every field is an axis of the speed-against-accuracy chart."""

    samples: int = 192
    """intervals along the longest side of the scene's box in the last stage, half as many in those before"""
    stages: tuple[int, ...] = (8, 4, 2, 1)
    """what the size of the picture is divided by, stage after stage"""

    def __post_init__(self) -> None:
        if self.samples < 2 or not self.stages or min(self.stages) < 1:
            raise ValueError(f"rendering needs at least 2 samples and a stage, got {self}")


@dataclass(frozen=True)
class RenderJob:
    """A picture to be drawn."""

    codes: Codes
    camera: Camera
    settings: RenderSettings = field(default_factory=RenderSettings)


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture as far as it is known. Its arrays are never written again."""

    image: UInt8[np.ndarray, "height width 3"]
    depth: Float32[np.ndarray, "height width"]
    """scene units; 0 on the ground"""
    opacity: Float32[np.ndarray, "height width"]
    stage: int
    """0 is the coarsest"""
    stages: int
    samples: int
    """along a ray"""
    seconds: float
    """since the job began"""
    asked: Int32[np.ndarray, "height width"] | None = None
    """samples of each ray that were evaluated, where that is known"""

    @property
    def resolution(self) -> tuple[int, int]:
        """(width, height) in px."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def final(self) -> bool:
        """Nothing finer follows."""
        return self.stage == self.stages - 1


def frames(model: Model, job: RenderJob) -> Iterator[Frame | None]:
    """Coarse to fine: a Frame after every stage, None after every chunk between, so that a newer job waits for one
    chunk at the most. To stop, ask for no more.
    """
    began = time.perf_counter()
    plan = _plan(job)
    kept = [stage for stage, (camera, samples) in enumerate(plan) if keeps(model, job.codes, camera, samples)]
    # A new texture is put at once on the finest picture whose shape is known.
    for stage in range(max(kept, default=0), len(plan)):
        seen = yield from march(model, job.codes, *plan[stage])
        image = (seen.colour.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()
        depth, opacity = seen.depth.cpu().numpy(), seen.opacity.cpu().numpy()
        seconds = time.perf_counter() - began
        asked = None if seen.asked is None else seen.asked.int().cpu().numpy()
        yield Frame(image, depth, opacity, stage, len(plan), plan[stage][1], seconds, asked)


def _plan(job: RenderJob) -> list[tuple[Camera, int]]:
    """The camera and the number of samples of every stage."""
    settings, plan = job.settings, []
    for stage, divisor in enumerate(settings.stages):
        width, height = (max(1, size // divisor) for size in (job.camera.width, job.camera.height))
        samples = settings.samples if stage == len(settings.stages) - 1 else max(1, settings.samples // 2)
        plan.append((job.camera.resized(width, height), samples))
    return plan


def picture(model: Model, codes: Codes, camera: Camera) -> Frame:
    """The finished frame at once."""
    *_, last = frames(model, RenderJob(codes, camera, RenderSettings(stages=(1,))))
    assert last is not None
    return last
