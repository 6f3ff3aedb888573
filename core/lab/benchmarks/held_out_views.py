"""Test cases of benchmarks: objects that no model was trained on, and views of them whose cameras are known."""

import math
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

from core.fitting.fit import PRESETS, FitJob, fit
from core.geometry.camera import Camera
from core.lab.datasets.srn import ObjectEntry, ObjectViews, index_objects
from core.lab.evaluation.protocol import ViewScore, as_photo, score_view
from core.metrics import psnr, rotation_error
from core.models.library import load_model
from core.models.model import Instance, Model
from core.photos.photo import Photo
from core.rendering.images import render_image

BENCHMARK = Path(__file__).resolve().parents[3] / "assets" / "benchmark"
DATASETS = (BENCHMARK / "chairs.views", BENCHMARK / "cars.views")
_Result = TypeVar("_Result")
MOST_PHOTOS = 5  # of an object in one fit
SCORED_VIEWS = 5  # other views of an object that score its fits
_AZIMUTH, _ELEVATION = 0.9, 0.4  # rad
_FAR = 20.0  # degrees: a camera further off may still be right by symmetry
_SYMMETRY_TOLERANCE = math.radians(5)  # a view is symmetric if it matches the true one as well as a turn by this does
_BACKGROUND = 0.99
"""brightness of all channels above which a pixel is background, for networks that render the background"""


@dataclass(frozen=True)
class Trial:
    """A measurement: the columns that tell the rows of all benchmarks apart."""

    category: str
    name: str  # of the object
    number: int  # of the random order of its views
    case: str


@dataclass(frozen=True, eq=False)
class HeldOutView:
    """An object, views of it to be fitted, and other views that score the fit. ``ValueError`` for too few views."""

    model: Model
    views: ObjectViews  # at the model's image size
    number: int = 0  # of the random order of the views
    partner: ObjectViews | None = None  # another object of the category
    stranger: ObjectViews | None = None  # an object of another category

    def __post_init__(self) -> None:
        if len(self.views.cameras) < MOST_PHOTOS + SCORED_VIEWS:
            raise ValueError(f"{self.views.name}: a benchmark needs {MOST_PHOTOS + SCORED_VIEWS} views of an object")

    def key(self, case: str) -> tuple[str, str, int, str]:
        """Return the fields of a :class:`Trial`."""
        return self.model.category, self.views.name, self.number, case

    @cached_property
    def order(self) -> list[int]:
        """The views in random order: photos, then the views that score."""
        generator = np.random.default_rng((zlib.crc32(self.views.name.encode()), self.number))
        return generator.permutation(len(self.views.cameras)).tolist()

    @property
    def seed(self) -> int:
        """Seed of fits and corruptions."""
        return self.order[0] + len(self.order) * self.number

    def photos(self, count: int, posed: bool) -> tuple[Photo, ...]:
        """Return the first photos; ``posed``: with their cameras."""
        return tuple(as_photo(self.views, index, posed) for index in self.order[:count])

    def cameras(self, count: int = 1) -> tuple[Camera, ...]:
        """Return the true cameras of the first photos."""
        return tuple(self.views.cameras[index] for index in self.order[:count])

    @property
    def usual_camera(self) -> Camera:
        """A camera that sees the object from the side and above, of the training images' size."""
        return self.model.camera(_AZIMUTH, _ELEVATION)

    def score(self, instance: Instance) -> ViewScore:
        """Return the mean score of the other views, rendered from their true cameras."""
        indices = self.order[MOST_PHOTOS : MOST_PHOTOS + SCORED_VIEWS]
        return ViewScore(*np.mean([score_view(instance, self.views, index) for index in indices], axis=0).tolist())

    @cached_property
    def instance(self) -> Instance:
        """The object, fitted to several photos with their cameras; without photo detail."""
        *_, last = fit(self.model, FitJob(self.photos(MOST_PHOTOS, True), PRESETS["draft"]))
        return last.instance.with_detail(None)

    def camera_error(self, fitted: Camera, truth: Camera) -> float:
        """Return the rotation error of a camera, degrees; 0 if the object looks the same from there."""
        error = rotation_error(fitted, truth)
        return 0.0 if error > _FAR and is_symmetric_view(self.instance, fitted, truth) else error


@lru_cache(maxsize=4)
def held_out_view(datasets: tuple[Path, ...], category: str, name: str, number: int) -> HeldOutView:
    """Return an object of datasets of a shipped model's category, with the next object and one of another category."""
    model = load_model(category)
    entries = dict[str, list[ObjectEntry]]()
    for kind, objects in map(index_objects, zip(datasets, strict=True)):
        entries.setdefault(kind, []).extend(objects)
    names = [entry.name for entry in entries[category]]
    position = names.index(name)
    strangers = next((objects for kind, objects in entries.items() if kind != category), [])

    def read(objects: Sequence[ObjectEntry], index: int) -> ObjectViews | None:
        return objects[index % len(objects)].read().reduced(model.image_size) if objects else None

    views = entries[category][position].read().reduced(model.image_size)
    partner = read(entries[category], position + 1) if len(names) > 1 else None
    return HeldOutView(model, views, number, partner, read(strangers, position))


def is_symmetric_view(instance: Instance, fitted: Camera, truth: Camera) -> bool:
    """Return whether both cameras show an object as alike as when the true one turns by a few degrees.

    A round stool has several right cameras; the one that rendered its image is no better than the others.
    """
    lift = -_SYMMETRY_TOLERANCE if truth.elevation > 0 else _SYMMETRY_TOLERANCE
    turned = replace(truth, azimuth=truth.azimuth + _SYMMETRY_TOLERANCE)
    lifted = replace(truth, elevation=truth.elevation + lift)
    true_image, *images = (render_on_white(instance, camera)[0] for camera in (truth, fitted, turned, lifted))
    fitted_psnr, *turned_psnrs = (psnr(image, true_image) for image in images)
    return fitted_psnr >= min(turned_psnrs)


def render_on_white(
    instance: Instance, camera: Camera
) -> tuple[Float[Tensor, "height width 3"], Bool[Tensor, "height width"]]:
    """Return an image in [0, 1] and the object's mask."""
    rendered = render_image(instance, camera)
    colour = rendered.colour.clamp(0, 1).cpu()
    return colour, (colour < _BACKGROUND).any(-1) if instance.model.white_from_network else rendered.opacity.cpu() > 0.5


def timed(run: Callable[[], _Result], clock: Callable[[], float] = time.process_time) -> tuple[float, _Result]:
    """Return the seconds of a function, of the processor by default, and its result."""
    began = clock()
    result = run()
    return clock() - began, result
