"""Renders with photo detail; codes without photos give those of :mod:`core.rendering`."""

from collections.abc import Iterator
from dataclasses import replace

from core.detail.maps import detail_maps
from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering import baking, progressive
from core.rendering.baked_field import BakedField
from core.rendering.progressive import Frame, RenderJob, RenderSettings
from core.rendering.reference import Rendered, render_exact
from core.streams import run_to_end


def render_progressively(model: Model, job: RenderJob) -> Iterator[Frame | None]:
    """Render like :func:`core.rendering.progressive.render_progressively`, with photo detail."""
    maps = yield from detail_maps(model, job.codes)
    yield from progressive.render_progressively(model, replace(job, detail=maps))


def render_frame(model: Model, codes: Codes, camera: Camera) -> Frame:
    """Return the finished frame, in one call."""
    *_, last = render_progressively(model, RenderJob(codes, camera, RenderSettings(divisors=(1,))))
    assert last is not None
    return last


def render_reference(model: Model, codes: Codes, camera: Camera) -> Rendered:
    """Return the exact render with photo detail."""
    maps = run_to_end(detail_maps(model, codes))
    rendered = render_exact(model, codes, camera)
    return rendered if maps is None else maps.added(rendered, camera)[0]


def bake(model: Model, codes: Codes) -> Iterator[BakedField | None]:
    """Bake like :func:`core.rendering.baking.bake`, with photo detail."""
    maps = yield from detail_maps(model, codes)
    for baked in baking.bake(model, codes):
        yield baked and replace(baked, detail=maps)
