from dataclasses import replace

import torch

from core.fitting.observations import Observation, sample_pixels
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.tiny import photo_of


def truncated_photo(tiny: Model) -> Photo:
    """A picture whose right third was not seen."""
    photo = photo_of(tiny[0], tiny.camera(0.9, 0.3))
    beyond = torch.zeros_like(photo.mask)
    beyond[:, 2 * photo.mask.shape[1] // 3 :] = True
    mask = photo.mask & ~beyond
    return replace(photo, mask=mask, pixels=photo.pixels.where(mask[..., None], torch.ones(())), unseen=beyond)


def test_sampled_pixels_represent_the_visible_photo(tiny: Model):
    observation = Observation.of(photo_of(tiny[0], tiny.camera(0.9, 0.3)), tiny)
    pixels = sample_pixels([observation], 4096, torch.Generator().manual_seed(0))
    assert abs(float(pixels.weights.sum()) - 1) < 1e-5
    on = float((pixels.target_opacity * pixels.weights).sum())
    assert abs(on - float(observation.target_opacity.mean())) < 1e-5
    photo = truncated_photo(tiny)
    observation = Observation.of(photo, tiny)
    pixels = sample_pixels([observation], 4096, torch.Generator().manual_seed(0))
    edge = observation.pixels.reshape(*photo.mask.shape, 2)[0, 2 * photo.mask.shape[1] // 3, 0]
    assert bool((pixels.pixels[..., 0] < edge).all())
    assert abs(float(pixels.weights.sum()) - 1) < 1e-5


def test_halves_of_sampled_pixels_represent_the_photo_too(tiny: Model):
    observation = Observation.of(photo_of(tiny[0], tiny.camera(0.9, 0.3)), tiny)
    pixels = sample_pixels([observation], 65, torch.Generator().manual_seed(0))
    halves = [pixels.subset(slice(first, None, 2)) for first in range(2)]
    assert [half.pixels.shape[1] for half in halves] == [33, 32]
    means = [float((half.target_opacity * half.weights).sum()) for half in halves]
    expected = float((pixels.target_opacity * pixels.weights).sum())
    assert abs((33 * means[0] + 32 * means[1]) / 65 - expected) < 1e-5


def test_certainty_is_lower_near_uncertain_edges(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(0.9, 0.3))
    sure, unsure = (Observation.of(replace(photo, edge_error=error), tiny).certainty for error in (0.0, 2.0))
    assert bool((sure == 1).all())
    assert 0 < float(unsure.min()) < 0.2
    assert float(unsure[0]) > 0.9  # a corner, far from the object
    photo = photo_of(tiny[0], tiny.camera(0.9, 0.3))
    soft = Observation.of(replace(photo, opacity=0.5 * photo.mask), tiny)
    assert soft.target_opacity.unique().tolist() == [0, 0.5]


def test_footprints_of_a_blurred_photo_have_the_variance_of_its_blur(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(0.9, 0.3))
    sharp, blurred = (Observation.of(replace(photo, blur=blur), tiny) for blur in (0.0, 3.0))
    single = sample_pixels([sharp], 400, torch.Generator().manual_seed(0))
    assert torch.equal(single.points, single.pixels)
    both = sample_pixels([sharp, blurred], 400, torch.Generator().manual_seed(0))
    assert both.points.shape == (2, 800, 2)
    assert not bool(both.footprints[0].any())
    spread = both.footprints[1].flatten(0, 1)
    torch.testing.assert_close(spread.T.cov(correction=0), (3 / tiny.focal) ** 2 * torch.eye(2), rtol=1e-3, atol=1e-7)
    torch.testing.assert_close(both.mean_of_rays(both.points[None])[0], both.pixels, rtol=1e-4, atol=1e-6)
