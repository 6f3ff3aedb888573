"""The progressive stream of pictures that a viewer shows: coarse at once, fine when the hand rests."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float32, UInt8

from core.camera import Camera
from core.codes import Codes
from core.model import Model
from core.render import Rendered, exact_rays, render_rays

_CHUNK_POINTS = 8192


@dataclass(frozen=True)
class RenderSettings:
    """Every field is an axis of the speed-against-accuracy chart."""

    samples: int = 64
    """along a ray, at every stage"""
    stages: tuple[int, ...] = (8, 4, 2, 1)
    """what the size of the picture is divided by, stage after stage"""


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
    shape_bias = model.field.shape_bias(job.codes.shape)
    texture_bias = model.field.texture_bias(job.codes.texture)
    settings = job.settings
    for stage, divisor in enumerate(settings.stages):
        width, height = (max(1, size // divisor) for size in (job.camera.width, job.camera.height))
        camera = job.camera.resized(width, height)
        rays = exact_rays(model, camera)
        hit = rays.near < rays.far
        met = rays[hit]
        parts = []
        chunk = max(1, _CHUNK_POINTS // settings.samples)
        for first in range(0, len(met.near), chunk):
            with torch.no_grad():
                parts.append(render_rays(model, met[first : first + chunk], settings.samples, shape_bias, texture_bias))
            yield None
        yield _frame(parts, hit, stage, settings, time.perf_counter() - began)


def _frame(parts: list[Rendered], hit: torch.Tensor, stage: int, settings: RenderSettings, seconds: float) -> Frame:
    colour = torch.ones(*hit.shape, 3)
    depth, opacity = torch.zeros(hit.shape), torch.zeros(hit.shape)
    if parts:
        colour[hit] = torch.cat([part.colour for part in parts]).cpu()
        depth[hit] = torch.cat([part.depth for part in parts]).cpu()
        opacity[hit] = torch.cat([part.opacity for part in parts]).cpu()
    image = (colour.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()
    return Frame(image, depth.numpy(), opacity.numpy(), stage, len(settings.stages), settings.samples, seconds)
