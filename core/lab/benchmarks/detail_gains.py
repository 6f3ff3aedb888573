"""The value of a photo's detail: other views against their angle from the photo, with it, without, without mirroring.

An object is fitted to one view, its camera known or searched for; the others are rendered from their true cameras. The
view that was fitted is compared at the fitted camera, also with the bound: the photo itself wherever the render without
detail is not empty.
"""

import statistics
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.detail.lookup import MIN_OPACITY, DetailMaps
from core.detail.maps import detail_maps
from core.fitting.fit import FitJob, fit
from core.geometry.camera import Camera
from core.lab.datasets.srn import ObjectEntry
from core.lab.evaluation.protocol import as_photo
from core.lab.evaluation.statistics import Mean, mean_of
from core.metrics import psnr, rotation_error
from core.models.model import Instance, Model
from core.models.photo_detail import PhotoView
from core.rendering.images import render_image
from core.streams import run_to_end

CAMERAS = "known", "found"


@dataclass(frozen=True)
class DetailView:
    """A view of a fitted object and its scores."""

    category: str
    renderer: str  # that drew the images
    camera: str  # one of CAMERAS
    name: str  # of the object
    view: int
    angle: float  # degrees from the photo; 0 for the photo itself
    rotation: float  # degrees, error of the camera
    confidence: float | None
    plain: float  # dB, without detail
    direct: float  # dB, without mirroring
    full: float  # dB
    bound: float | None = None  # dB of the photo where the render is not empty; only for the photo itself

    @property
    def key(self) -> tuple[str, str, str, str]:
        """The key shared by all views of a fit."""
        return self.category, self.renderer, self.camera, self.name


def unfitted_views(rows: Iterable[DetailView]) -> list[DetailView]:
    """Return the views that were not fitted."""
    return [row for row in rows if row.bound is None]


def object_gains(rows: Sequence[DetailView], score: str = "full") -> list[float]:
    """Return each object's mean gain in dB over the render without detail."""
    gains: dict[str, list[float]] = {}
    for row in rows:
        gains.setdefault(row.name, []).append(getattr(row, score) - row.plain)
    return [statistics.mean(view_gains) for view_gains in gains.values()]


def gain_by_object(rows: Sequence[DetailView], score: str = "full") -> Mean:
    """Return the mean gain in dB, with its interval over objects."""
    return mean_of(object_gains(rows, score))


def measure_detail(
    model: Model,
    entries: Sequence[ObjectEntry],
    renderer: str,
    input_view: int,
    stride: int,
    done: Collection[tuple[str, str, str, str]] = (),
) -> Iterator[DetailView]:
    """Fit each object and yield a row per view, those of a fit together.

    Args:
        stride: over the other views.
        done: keys of fits to leave out.
    """
    for entry in entries:
        for camera in CAMERAS:
            if (model.category, renderer, camera, entry.name) in done:
                continue
            views = entry.read()
            *_, last = fit(model, FitJob((as_photo(views, input_view, camera == "known"),)))
            truth = views.cameras[input_view]
            maps = run_to_end(detail_maps(last.instance))
            detail = last.instance.detail
            assert detail is not None
            row = DetailView(
                *(model.category, renderer, camera, entry.name, input_view, 0.0),
                *(rotation_error(last.cameras[0], truth), last.confidence, 0.0, 0.0, 0.0),
            )
            rows = [_input_row(last.instance, maps, detail.views[0], last.cameras[0], row)]
            for view in range(0, len(views.cameras), stride):
                if view == input_view:
                    continue
                target = views.cameras[view]
                image = torch.from_numpy(views.images[view]).float() / 255
                view_row = replace(row, view=view, angle=rotation_error(target, truth))
                rows.append(_scored(view_row, last.instance, maps, target, image))
            yield from rows


def _scored(
    row: DetailView, instance: Instance, maps: DetailMaps | None, camera: Camera, image: Float[Tensor, "h w 3"]
) -> DetailView:
    """Return the row with the PSNR without detail, without mirroring and with all of it."""
    plain = psnr(render_image(instance.with_detail(None), camera).colour.clamp(0, 1).cpu(), image)
    if maps is None:
        return replace(row, plain=plain, direct=plain, full=plain)
    rendered = render_image(instance, camera)
    full, direct = (
        psnr(variant.added(rendered, camera)[0].colour.cpu(), image)
        for variant in (maps, replace(maps, other_side="model"))
    )
    return replace(row, plain=plain, direct=direct, full=full)


def _input_row(
    instance: Instance, maps: DetailMaps | None, photo: PhotoView, camera: Camera, row: DetailView
) -> DetailView:
    """Return the row of the photo itself, at its fitted camera and the size of the model's images."""
    size = instance.model.image_size
    side = round(photo.camera.focal / camera.focal * camera.height)
    rgba = torch.from_numpy(photo.pixels()).float().movedim(-1, 0) / 255
    columns = (side - photo.camera.width) // 2
    rows = (side - photo.camera.height) // 2
    white = functional.pad(rgba[:3], (columns, columns, rows, rows), value=1.0)
    image = functional.adaptive_avg_pool2d(white, (size, size)).movedim(0, -1)
    target = replace(photo.camera, width=side, height=side).resized(size, size)
    rendered = render_image(instance.with_detail(None), target)
    transmittance = 1 - rendered.opacity[..., None].cpu()
    bound = torch.where(
        transmittance < 1 - MIN_OPACITY, torch.maximum(image, transmittance), rendered.colour.clamp(0, 1).cpu()
    )
    return _scored(replace(row, bound=psnr(bound, image)), instance, maps, target, image)
