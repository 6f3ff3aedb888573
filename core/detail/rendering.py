"""Renders with photo detail; codes without photos give those of :mod:`core.rendering`."""

from collections.abc import Iterator
from dataclasses import replace

from core.detail.maps import detail_maps
from core.geometry.camera import Camera
from core.models.model import Instance
from core.rendering import baking, progressive
from core.rendering.baked_field import BakedField
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from core.rendering.reference import Rendered, render_exact
from core.streams import run_to_end


def render_progressively(job: RenderJob) -> Iterator[Frame | None]:
    """Render like :func:`core.rendering.progressive.render_progressively`, with photo detail."""
    maps = yield from detail_maps(job.instance)
    yield from progressive.render_progressively(replace(job, detail=maps))


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


def bake(instance: Instance) -> Iterator[BakedField | None]:
    """Bake like :func:`core.rendering.baking.bake`, with photo detail."""
    maps = yield from detail_maps(instance)
    for baked in baking.bake(instance):
        yield baked and replace(baked, detail=maps)
