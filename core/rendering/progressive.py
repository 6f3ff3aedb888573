"""The progressive stream of pictures that a viewer shows: coarse at once, fine when the hand rests."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32, UInt8
from torch import Tensor

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.fast import keeps, march
from core.rendering.reference import Rendered


@dataclass(frozen=True)
class RenderSettings:
    """Every field is an axis of the speed-against-accuracy chart."""

    samples: int = 192
    """intervals along the longest side of the scene's box in the last stage"""
    stages: tuple[int, ...] = (8, 4, 2, 1)
    """what the size of the picture is divided by, stage after stage"""
    moving: int = 64
    """intervals in the stages before the last"""
    across: int = 1
    """where above 1, one more stage draws so many pixels across each pixel, and as many down"""

    def __post_init__(self) -> None:
        if min(self.samples, self.moving) < 2 or not self.stages or min(*self.stages, self.across) < 1:
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
    across: int = 1
    """pixels drawn across each pixel, and as many down"""

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
    # A new texture is put at once on the finest picture whose shape is known, if it is drawn pixel by pixel.
    kept = [at for at, stage in enumerate(plan) if stage.across == 1 and keeps(model, job.codes, *stage.view)]
    for at in range(max(kept, default=0), len(plan)):
        stage = plan[at]
        seen = _joined((yield from march(model, job.codes, *stage.view)), stage.across)
        image = (seen.colour.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()
        depth, opacity = seen.depth.cpu().numpy(), seen.opacity.cpu().numpy()
        seconds = time.perf_counter() - began
        asked = None if seen.asked is None else seen.asked.int().cpu().numpy()
        yield Frame(image, depth, opacity, at, len(plan), stage.view.samples, seconds, asked, stage.across)


class _View(NamedTuple):
    """As :func:`core.rendering.fast.march` takes it."""

    camera: Camera
    samples: int
    whole: bool


class _Stage(NamedTuple):
    """A picture on the way."""

    view: _View
    across: int = 1


def _plan(job: RenderJob) -> list[_Stage]:
    """From the coarsest to the last stage. Whole occupancy is asked for once the picture has its size."""
    settings, (width, height) = job.settings, (job.camera.width, job.camera.height)
    plan = []
    for at, divisor in enumerate(settings.stages):
        samples = settings.samples if at == len(settings.stages) - 1 else settings.moving
        camera = job.camera.resized(max(1, width // divisor), max(1, height // divisor))
        plan.append(_Stage(_View(camera, samples, divisor == 1)))
    if settings.across > 1:
        camera = job.camera.resized(width * settings.across, height * settings.across)
        plan.append(_Stage(_View(camera, settings.samples, True), settings.across))
    return plan


def _joined(seen: Rendered, across: int) -> Rendered:
    """Squares of pixels as their mean; a depth is that of the part which shows the object."""
    if across == 1:
        return seen
    colour, opacity = (_means(part, across) for part in (seen.colour, seen.opacity[..., None]))
    depth = _means((seen.depth * seen.opacity)[..., None], across) / opacity.clamp_min(1e-6)
    asked = None if seen.asked is None else _means(across**2 * seen.asked[..., None].float(), across)[..., 0].long()
    return Rendered(colour, depth[..., 0], opacity[..., 0], asked)


def _means(image: Float[Tensor, "rows columns channels"], across: int) -> Float[Tensor, "height width channels"]:
    rows, columns, channels = image.shape
    return image.reshape(rows // across, across, columns // across, across, channels).mean((1, 3))


def picture(model: Model, codes: Codes, camera: Camera) -> Frame:
    """The finished frame at once."""
    *_, last = frames(model, RenderJob(codes, camera, RenderSettings(stages=(1,))))
    assert last is not None
    return last
