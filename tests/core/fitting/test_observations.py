from dataclasses import replace

import torch

from core.fitting.observations import Target, draw
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.tiny import photo_of


def seen(tiny: Model) -> Photo:
    """A picture whose right third was not seen."""
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3))
    beyond = torch.zeros_like(photo.mask)
    beyond[:, 2 * photo.mask.shape[1] // 3 :] = True
    mask = photo.mask & ~beyond
    return replace(photo, mask=mask, pixels=photo.pixels.where(mask[..., None], torch.ones(())), beyond=beyond)


def test_pixels_stand_for_the_whole_picture(tiny: Model):
    target = Target.of(photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)), tiny)
    drawn = draw([target], 4096, torch.Generator().manual_seed(0))
    assert abs(float(drawn.shares.sum()) - 1) < 1e-5
    on = float((drawn.opaque * drawn.shares).sum())
    assert abs(on - float(target.opaque.mean())) < 1e-5


def test_what_was_not_seen_is_not_drawn(tiny: Model):
    photo = seen(tiny)
    target = Target.of(photo, tiny)
    drawn = draw([target], 4096, torch.Generator().manual_seed(0))
    edge = target.places.reshape(*photo.mask.shape, 2)[0, 2 * photo.mask.shape[1] // 3, 0]
    assert bool((drawn.places[..., 0] < edge).all())
    assert abs(float(drawn.shares.sum()) - 1) < 1e-5
