"""The input of a fit (the job) and its constants: observations, known cameras, objective and scoring pixels."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.classifiers.viewpoint import predict_viewpoint, uniform_directions, with_side, with_witness
from core.fitting.hypotheses import Hypothesis
from core.fitting.imagined import ImaginedViews
from core.fitting.objective import (
    CAMERA_PRIOR_SCALE,
    CAMERA_PRIOR_WEIGHT,
    MASK_WEIGHT,
    MOVED_SCALE,
    OCCLUDER_SCALE,
    SCALED_SCALE,
    Objective,
)
from core.fitting.observations import Observation, PixelBatch, sample_pixels
from core.fitting.settings import ALL_COMPONENTS, Components, FitSettings
from core.geometry.camera import Camera
from core.models.codes import CodeSpace
from core.models.latents import Latents
from core.models.model import Model
from core.models.view_bank import ViewBank
from core.photos.photo import Photo
from core.photos.ranking import ObjectMask, expected_scales
from core.photos.view_bank import view_bank

MOST_PHOTOS = 12  # of one object
_TELLING = 6  # crops of one object whose perspective tells focal lengths: eight frames did, four photographs did not
SCORING_RAYS = 2048  # shared by all photos, constant
_VALIDATION_RAYS = 512  # shared by all photos, not used by steps: for the uncertainty of a camera


@dataclass(frozen=True, eq=False)
class FitJob:
    """Photos of one object to fit.

    Raises ``ValueError`` without photos, with more than :data:`MOST_PHOTOS`, or if a resumed fit had more.
    """

    photos: tuple[Photo, ...]
    settings: FitSettings = field(default_factory=FitSettings)
    seed: int = 0
    resume_from: Hypothesis | None = None  # refine this one, without a search; its object places further photos
    components: Components = ALL_COMPONENTS  # enabled components, for ablations

    @property
    def tells_focal(self) -> bool:
        """True if the object's perspective in several crops tells their focal lengths."""
        crops = [photo for photo in self.photos if photo.camera is None and photo.focal is None and photo.scaled]
        return len(crops) >= _TELLING

    def __post_init__(self) -> None:
        if not self.photos:
            raise ValueError("there is no photo to fit")
        if len(self.photos) > MOST_PHOTOS:
            raise ValueError(f"one object has at most {MOST_PHOTOS} photos, got {len(self.photos)}")
        if self.added.start > len(self.photos):
            raise ValueError("a fit resumes with the photos that it had, and others after them")

    @property
    def added(self) -> range:
        """Numbers of the photos that join those of the result from which the fit resumes."""
        return range(len(self.resume_from.cameras if self.resume_from else self.photos), len(self.photos))


@dataclass(frozen=True, eq=False)
class Problem:
    """The constant part of a fit: photos of one object with unknown codes and cameras."""

    model: Model  # without contrast
    shown_model: Model  # with it, for results
    bank: ViewBank | None  # None: start from random cameras and the mean shape
    settings: FitSettings
    components: Components
    photos: tuple[Photo, ...]
    observations: tuple[Observation, ...]
    cameras: tuple[Camera, ...]  # known cameras; for unknown ones their size and focal length
    viewpoints: tuple[Float[Tensor, "directions"] | None, ...]
    """probability of every viewing direction, for unknown cameras of models with a classifier"""
    scoring: PixelBatch  # pixels to compare hypotheses on
    validation: PixelBatch
    occluded: bool = False  # an occluder may hide parts of the object
    origin: Latents | None = None  # see hypothesis_biases
    imagined: ImaginedViews | None = None  # on which hypotheses are compared, too; steps draw their own

    @classmethod
    def of(cls, model: Model, job: FitJob, generator: torch.Generator) -> "Problem":
        """Build from a job. Raises ``ValueError`` if a photo shows no object."""
        components = job.components
        photos = job.photos
        if job.settings.estimate_focal:
            photos = tuple(replace(photo, focal=None) for photo in photos)
        observations = tuple(Observation.of(photo, model) for photo in photos)
        cameras = tuple(photo.camera or nominal_camera(photo, model) for photo in photos)
        viewpoints = tuple(_viewpoint(model, photo, components) for photo in photos)
        scoring, validation = (
            sample_pixels(observations, max(1, rays // len(photos)), generator)
            for rays in (SCORING_RAYS, _VALIDATION_RAYS)
        )
        bank = view_bank(model) if components.view_bank else None
        return cls(
            model.soft,
            model,
            bank,
            job.settings,
            components,
            photos,
            observations,
            cameras,
            viewpoints,
            scoring,
            validation,
        )

    @property
    def unknown(self) -> Bool[Tensor, "views"]:
        """Mark the photos with unknown cameras, without those left out."""
        return self.included & torch.tensor([photo.camera is None for photo in self.photos])

    @property
    def included(self) -> Bool[Tensor, "views"]:
        """Mark the photos that are not left out (:meth:`without`)."""
        return torch.tensor([observation.weight > 0 for observation in self.observations])

    def without(self, view: int) -> "Problem":
        """Return the problem in which a photo has no weight and its camera stays."""
        weight = torch.ones(len(self.photos), 1)
        weight[view] = 0.0
        observations = list(self.observations)
        observations[view] = replace(observations[view], weight=0.0)
        scoring, validation = (
            pixels._replace(certainty=weight * pixels.certainty, weights=weight * pixels.weights)
            for pixels in (self.scoring, self.validation)
        )
        return replace(self, observations=tuple(observations), scoring=scoring, validation=validation)

    @property
    def has_one_unknown(self) -> bool:
        """True if exactly one camera is unknown: it has rivals and a confidence."""
        return int(self.unknown.sum()) == 1

    @property
    def free(self) -> Bool[Tensor, "views 8"]:
        """Mark the searched camera parameters; for a cropped photo also roll and shift.

        A scaled photo without known focal length has its scale searched instead of the distance.
        """
        cropped = self.unknown & torch.tensor([photo.cropped for photo in self.photos])
        scaled = cropped & torch.tensor([photo.focal is None for photo in self.photos])
        pose = self.unknown[:, None].expand(-1, 2)
        focal = self.unknown & self.settings.estimate_focal
        size = torch.stack((self.unknown & ~scaled, focal & (scaled | ~cropped), scaled), 1)
        return torch.cat((pose, size, cropped[:, None].expand(-1, 3)), 1)

    @property
    def spaces(self) -> tuple[CodeSpace, CodeSpace]:
        """Code spaces of shape and texture in which the fit searches."""
        return self.model.codes.shape_space, self.model.codes.texture_space

    def objective(self, robust_scale: float) -> Objective:
        """Return the objective with a scale of the robust loss (:attr:`Objective.robust_scale`)."""
        scale = torch.tensor([CAMERA_PRIOR_SCALE]).repeat(len(self.photos), 1)
        for prior, photo in zip(scale, self.photos, strict=True):
            if photo.cropped:
                prior[3] = SCALED_SCALE if photo.scaled else MOVED_SCALE
                prior[5:] = math.inf  # the shift
            if photo.focal is not None:
                prior[1:4] = math.inf  # the distance follows from the size
        scale[~self.unknown] = math.inf
        weight = torch.tensor(CAMERA_PRIOR_WEIGHT) * self.components.camera_prior
        mask_weight = MASK_WEIGHT if self.components.mask_loss and not self.model.white_from_network else 0.0
        return Objective(
            self.settings.code_prior,
            camera_scale=scale,
            camera_weight=weight,
            expected_scale=self.expected_scale,
            mask_weight=mask_weight,
            robust_scale=robust_scale,
            occluder_scale=OCCLUDER_SCALE if self.occluded else math.inf,
        )

    @cached_property
    def expected_scale(self) -> Float[Tensor, "views directions"] | None:
        """Expected log scale of scaled photos for all viewing directions, 0 for other photos.

        None without scaled photos or without a view bank.
        """
        scaled = self.unknown & torch.tensor([photo.scaled and photo.focal is None for photo in self.photos])
        if self.bank is None or not bool(scaled.any()):
            return None
        images = [ObjectMask(photo.mask, camera.focal) for photo, camera in zip(self.photos, self.cameras, strict=True)]
        scales = torch.stack([expected_scales(self.bank, image) for image in images])
        return scales * scaled[:, None]


def _viewpoint(model: Model, photo: Photo, components: Components) -> Float[Tensor, "directions"] | None:
    """Return the probability of every viewing direction, from all that is known of a photo; None if nothing is."""
    classifier = model.viewpoint_classifier if components.viewpoint_classifier else None
    if photo.camera or (classifier is None and photo.side is None):
        return None
    probability = uniform_directions()
    if classifier:
        probability = predict_viewpoint(classifier, photo.pixels, photo.mask)
        if direction := witness_direction(model, photo):
            probability = with_witness(probability, *direction)
    return with_side(probability, photo.side) if photo.side else probability


def witness_direction(model: Model, photo: Photo) -> tuple[float, float] | None:
    """Return azimuth and elevation (rad) from a chair's 3D box; None for other categories or a known camera."""
    return photo.direction if model.category == "chairs" and photo.camera is None else None


def nominal_camera(photo: Photo, model: Model) -> Camera:
    """Return a camera of the photo's size with the training images' field of view and distance, at angles 0."""
    height, width = photo.mask.shape
    return Camera(0.0, 0.0, model.distance, model.focal * height / model.image_size, width, height)
