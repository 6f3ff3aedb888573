from dataclasses import replace

import torch

from core.fitting.observations import Observation, sample_pixels
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.tiny import photo_of


def seen(tiny: Model) -> Photo:
    """A picture whose right third was not seen."""
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3))
    beyond = torch.zeros_like(photo.mask)
    beyond[:, 2 * photo.mask.shape[1] // 3 :] = True
    mask = photo.mask & ~beyond
    return replace(photo, mask=mask, pixels=photo.pixels.where(mask[..., None], torch.ones(())), unseen=beyond)


def test_pixels_stand_for_the_whole_photo(tiny: Model):
    observation = Observation.of(photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)), tiny)
    pixels = sample_pixels([observation], 4096, torch.Generator().manual_seed(0))
    assert abs(float(pixels.weights.sum()) - 1) < 1e-5
    on = float((pixels.target_opacity * pixels.weights).sum())
    assert abs(on - float(observation.target_opacity.mean())) < 1e-5


def test_what_was_not_seen_is_not_sampled(tiny: Model):
    photo = seen(tiny)
    observation = Observation.of(photo, tiny)
    pixels = sample_pixels([observation], 4096, torch.Generator().manual_seed(0))
    edge = observation.pixels.reshape(*photo.mask.shape, 2)[0, 2 * photo.mask.shape[1] // 3, 0]
    assert bool((pixels.pixels[..., 0] < edge).all())
    assert abs(float(pixels.weights.sum()) - 1) < 1e-5
