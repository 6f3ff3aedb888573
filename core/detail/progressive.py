"""Frames with photo detail, as a stream for a viewer: coarse at once, fine while nothing changes."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float32, Int32, UInt8

from core.detail.maps import detail_maps
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.models.model import Instance
from core.rendering.ground_shadow import GroundShadow
from core.rendering.images import SAMPLES, is_cached, render_steps
from core.rendering.occupancy import shape_occupancy
from core.rendering.reference import Rendered, render_exact
from core.runtime.modes import isolated
from core.streams import run_to_end


@dataclass(frozen=True)
class RenderSettings:
    """The trade-off of a render between speed and accuracy. Raises ``ValueError`` for unusable values."""

    samples: int = SAMPLES  # intervals along the longest side of the scene's box in the last stage
    divisors: tuple[int, ...] = (8, 4, 2, 1)  # of the image's width and height, stage by stage
    preview_samples: int = 64  # intervals in the stages before the last

    def __post_init__(self) -> None:
        if min(self.samples, self.preview_samples) < 2 or min(self.divisors, default=0) < 1:
            raise ValueError(f"rendering needs at least 2 samples and a stage, got {self}")


@dataclass(frozen=True)
class RenderJob:
    """An image to render."""

    instance: Instance
    camera: Camera
    settings: RenderSettings = field(default_factory=RenderSettings)
    shadow: bool = False  # request :attr:`Frame.shadow`


@dataclass(frozen=True, eq=False)
class Frame:
    """An image at one stage of refinement. Its arrays are not modified after creation."""

    image: UInt8[np.ndarray, "height width 3"]
    depth: Float32[np.ndarray, "height width"]  # scene units; 0 on the background
    opacity: Float32[np.ndarray, "height width"]
    stage: int  # 0 is the coarsest
    stage_count: int
    samples: int  # along a ray
    seconds: float  # since the job began
    evaluations: Int32[np.ndarray, "height width"] | None = None  # samples of each ray with evaluated density, if known
    sources: Float32[np.ndarray, "height width 2"] | None = None
    """fractions of each pixel's colour from a photo and from a mirrored photo, 0..1; None: all from the model"""
    shadow: GroundShadow | None = None
    """the object's shadow on the ground, to be drawn over a background; not part of the image"""
    ray_seconds: float = 0.0  # of :attr:`seconds`, for the rays of this stage; 0: not measured

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def photo_shares(self) -> tuple[float, float]:
        """Mean fractions of the object's colours from photos and from mirrored photos; the model has the rest."""
        if self.sources is None:
            return 0.0, 0.0
        photo, mirrored = self.sources.sum((0, 1)) / max(float(self.opacity.sum()), 1e-6)
        return float(photo), float(mirrored)

    @property
    def final(self) -> bool:
        """True for the last stage."""
        return self.stage == self.stage_count - 1


@isolated
def render_progressively(job: RenderJob) -> Iterator[Frame | None]:
    """Render from coarse to fine: yield a Frame after every stage, and None after every chunk of rays.

    To stop, abandon the iterator: a newer job waits for one chunk at most.
    """
    began = time.perf_counter()
    maps = yield from detail_maps(job.instance)
    stages = _stages(job)
    # A new texture begins with the finest stage whose shape is cached.
    cached = [number for number, stage in enumerate(stages) if is_cached(job.instance, *stage)]
    for number in range(max(cached, default=0), len(stages)):
        camera, samples, complete = stages[number]
        local = job.instance.local_camera(camera)
        shadow = shape_occupancy(job.instance, complete).shadow if job.shadow else None
        shadow = shadow and shadow.stretched(job.instance.codes.proportions)
        began_rays = time.perf_counter()  # the shape's cells, which the shadow needs, are found
        rendered = yield from render_steps(job.instance, camera, samples, complete)
        ray_seconds = time.perf_counter() - began_rays
        sources = None
        if maps:
            rendered, fractions = maps.added(rendered, local)
            sources = torch.stack(fractions, -1).cpu().numpy()
        image = to_bytes(rendered.colour)
        depth = local.seen_lengths(rendered.depth.cpu()).numpy()
        opacity = rendered.opacity.cpu().numpy()
        seconds = time.perf_counter() - began
        evaluations = None if rendered.evaluations is None else rendered.evaluations.int().cpu().numpy()
        yield Frame(
            image, depth, opacity, number, len(stages), samples, seconds, evaluations, sources, shadow, ray_seconds
        )


def render_frame(instance: Instance, camera: Camera) -> Frame:
    """Return the finished frame, in one call."""
    *_, last = render_progressively(RenderJob(instance, camera, RenderSettings(divisors=(1,))))
    assert last is not None
    return last


def render_reference(instance: Instance, camera: Camera) -> Rendered:
    """Return the exact render with photo detail."""
    maps = run_to_end(detail_maps(instance))
    rendered = render_exact(instance, camera)
    return rendered if maps is None else maps.added(rendered, instance.local_camera(camera))[0]


def _stages(job: RenderJob) -> list[tuple[Camera, int, bool]]:
    """Return the stages from coarse to fine: arguments of :func:`core.rendering.images.render_steps`.

    Only the last stage needs the complete occupancy of a new shape.
    """
    settings = job.settings
    stages = []
    for number, divisor in enumerate(settings.divisors, 1):
        last = number == len(settings.divisors)
        samples = settings.samples if last else settings.preview_samples
        camera = job.camera.resized(max(1, job.camera.width // divisor), max(1, job.camera.height // divisor))
        stages.append((camera, samples, last))
    return stages
