"""Disentanglement: two objects exchange their textures, and a fit of the image undoes the exchange.

The opacity must not change with the texture. If codes are disentangled, the fit of an image of one object's shape in
another's texture finds both: with its first texture the shape looks as before, and the texture looks as on its object.
"""

from dataclasses import dataclass

from core.fitting.fit import PRESETS, FitJob, fit
from core.lab.benchmarks.held_out_views import HeldOutView, Trial, render_on_white
from core.metrics import psnr
from core.models.model import Instance
from core.photos.photo import Photo
from core.rendering.images import render_image

_PHOTOS = 2  # rendered of the exchanged object
_SCORED = 3  # cameras from which results are compared


@dataclass(frozen=True)
class ExchangeTrial(Trial):
    """An object in another's texture."""

    partner: str  # the object whose texture it takes
    n: int  # compared images
    opacity: float  # largest change of a pixel's opacity, 0..1
    exchanged: float  # dB, the fit against the exchanged object
    shape: float  # dB, the fit in the object's own texture against the object
    texture: float  # dB, the partner in the fit's texture against the partner


def cases(quick: bool) -> tuple[str, ...]:
    """Return the name of the only case."""
    return ("exchange",)


def measure(view: HeldOutView, case: str) -> tuple[ExchangeTrial, ...]:
    """Exchange textures with the next object of the dataset; return nothing if it is the only one."""
    if view.partner is None:
        return ()
    instance = view.instance
    partner = HeldOutView(view.model, view.partner, view.number).instance
    exchanged = instance.with_texture(partner)
    cameras = [view.views.cameras[index] for index in view.order]
    photos = tuple(Photo(*render_on_white(exchanged, camera), camera) for camera in cameras[:_PHOTOS])
    *_, last = fit(view.model, FitJob(photos, PRESETS["normal"], view.seed))
    fitted = last.instance.with_detail(None)
    scored = cameras[_PHOTOS : _PHOTOS + _SCORED]

    def similarity(first: Instance, second: Instance) -> float:
        pairs = ((render_on_white(side, camera)[0] for side in (first, second)) for camera in scored)
        return sum(psnr(*pair) for pair in pairs) / len(scored)

    opacities = ([render_image(side, camera).opacity for camera in scored] for side in (instance, exchanged))
    trial = ExchangeTrial(
        *(*view.key(case), view.partner.name, len(scored)),
        opacity=max(float((first - second).abs().max()) for first, second in zip(*opacities, strict=True)),
        exchanged=similarity(fitted, exchanged),
        shape=similarity(fitted.with_texture(instance), instance),
        texture=similarity(partner.with_texture(fitted), partner),
    )
    return (trial,)
