"""Inputs of the tests of fits: quick settings, hypotheses, pixels of a photo, problems."""

import torch

from core.fitting.hypotheses import Parameters
from core.fitting.observations import Observation, PixelBatch, sample_pixels
from core.fitting.problem import FitJob, Problem
from core.fitting.settings import ALL_COMPONENTS, Components, FitSettings
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.tiny import photo_of

QUICK = FitSettings(hypotheses=8, steps=60, rays=128, samples=24, max_restarts=0)
SHORT = FitSettings(hypotheses=4, steps=8, rays=48, samples=12, free_steps=0, max_restarts=0)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def random_parameters(count: int = 3, elevation: float = 0.5) -> Parameters:
    """Cameras near each other, and codes anywhere."""
    generator = seeded()
    angles = torch.tensor([0.5, elevation]) + 0.2 * torch.rand(count, 1, 2, generator=generator)
    distance = 0.1 * torch.randn(count, 1, generator=generator)
    zoom = torch.full((count, 1), 0.1)
    shape, texture = (torch.randn(count, 2, generator=generator) for _ in range(2))
    return Parameters(angles, distance, zoom, torch.zeros(count, 1, 4), shape, texture)


def standing(distance: float, elevation: float = 0.5, views: int = 1, zoom: float = 0.0) -> Parameters:
    """One hypothesis of the mean codes, the same for every view."""
    angles = torch.tensor([0.0, elevation]).expand(1, views, 2)
    log_distance, log_focal = (torch.full((1, views), value) for value in (distance, zoom))
    return Parameters(angles, log_distance, log_focal, torch.zeros(1, views, 4), torch.zeros(1, 2), torch.zeros(1, 2))


def pixels_of(model: Model, rays: int = 96) -> PixelBatch:
    photo = photo_of(model[0], model.camera(0.5, 0.5))
    return sample_pixels([Observation.of(photo, model)], rays, seeded())


def problem_of(
    model: Model, *photos: Photo, settings: FitSettings = QUICK, components: Components = ALL_COMPONENTS, seed: int = 0
) -> Problem:
    job = FitJob(photos, settings, components=components)
    return Problem.of(model, job, seeded(seed))
