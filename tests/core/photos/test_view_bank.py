import math
from collections import OrderedDict
from itertools import zip_longest

import pytest
import torch

from core.metrics import rotation_error
from core.models.codes import Codes
from core.models.model import Model
from core.photos import view_bank as starts
from core.photos.view_bank import apparent, bank_of, likenesses, preparing, ranked, surface
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.tiny import EXTENT

VIEWS = [(0.3, 0.3), (1.4, 0.7), (2.5, 0.1), (3.7, 0.9), (4.6, 0.4), (5.6, 1.3)]


@pytest.mark.parametrize("azimuth, elevation", VIEWS)
def test_a_true_camera_is_among_the_first_few(tiny: Model, azimuth: float, elevation: float):
    camera = tiny.camera(azimuth, elevation)
    seen = render_exact(tiny, tiny.codes[2], camera, 48)
    starts = ranked(bank_of(tiny), tiny, seen.colour, seen.opacity > 0.5, camera.focal, 8)
    errors = [
        rotation_error(tiny.camera(float(a), float(e)), camera)
        for a, e in zip(starts.azimuth, starts.elevation, strict=True)
    ]
    assert min(errors) < 25


def test_every_start_comes_with_its_twin(tiny: Model):
    seen = render_exact(tiny, tiny.codes[0], tiny.camera(0.5, 0.4), 32)
    starts = ranked(bank_of(tiny), tiny, seen.colour, seen.opacity > 0.5, tiny.focal, 8)
    pairs = starts.azimuth.reshape(4, 2)
    assert torch.allclose((pairs[:, 0] - pairs[:, 1]).cos(), torch.tensor(-1.0), atol=1e-5)
    assert torch.equal(starts.elevation[::2], starts.elevation[1::2])
    assert len({(round(float(a), 4), round(float(e), 4)) for a, e in zip(*starts[:2], strict=True)}) == 8


def test_an_object_of_the_bank_looks_like_itself(tiny: Model):
    bank = bank_of(tiny)
    for index in range(len(bank.codes.shape)):
        for azimuth, elevation in ((0.8, 0.2), (2.0, 1.35)):
            codes = Codes(bank.codes.shape[index], bank.codes.texture[index])
            seen = render_exact(tiny, codes, tiny.camera(azimuth, elevation), 32)
            scores = likenesses(bank, seen.colour, seen.opacity > 0.5, tiny.focal, azimuth, elevation)
            assert float(scores[index]) > float(scores.max()) - 0.05


@pytest.mark.parametrize("factor", [0.75, 1.0, 1.4])
def test_the_distance_follows_from_the_apparent_size(tiny: Model, factor: float):
    camera = tiny.camera(1.0, 0.5, factor * tiny.distance)
    seen = render_exact(tiny, tiny.codes[1], camera, 48)
    starts = ranked(bank_of(tiny), tiny, seen.colour, seen.opacity > 0.5, camera.focal, 4)
    assert float(starts.distance[0]) == pytest.approx(camera.distance, rel=0.3)


@pytest.mark.parametrize("side", [0, 1])
def test_what_an_edge_cuts_off_is_guessed(tiny: Model, side: int):
    bank = bank_of(tiny)
    seen = render_exact(tiny, Codes(bank.codes.shape[1], bank.codes.texture[1]), tiny.camera(1.0, 0.5), 48)
    mask = seen.opacity > 0.5
    first, last = (int(end) for end in mask.any(1 - side).nonzero()[[0, -1], 0])
    beyond = torch.zeros_like(mask)
    beyond.movedim(side, 0)[: first + (last - first) // 3] = True
    rest = seen.colour.where(~beyond[..., None], torch.ones(())), mask & ~beyond
    whole = ranked(bank, tiny, seen.colour, mask, tiny.focal, 1, framed=True)
    kept, guessed = (ranked(bank, tiny, *rest, tiny.focal, 1, True, unseen) for unseen in (None, beyond))
    lost, left = (float((starts.shift - whole.shift).norm()) for starts in (kept, guessed))
    assert left < 0.6 * lost


def test_the_surface_lies_in_the_box_and_has_the_colours_of_the_object(tiny: Model):
    points, colours = surface(tiny, tiny.codes[3])
    assert len(points) > 500
    assert bool((points.abs() < EXTENT[0]).all())
    assert 0 <= float(colours.min()) <= float(colours.max()) <= 1


def test_how_objects_stand_in_training_pictures(tiny: Model):
    usual = apparent(tiny)
    seen = render_exact(tiny, tiny.codes[0], tiny.camera(0.7, 0.4), 32).opacity > 0.5
    size = max(int(seen.any(0).sum()), int(seen.any(1).sum())) / tiny.image_size
    assert usual.least < size < usual.most


def test_a_bank_is_made_once_per_model(tiny: Model):
    assert bank_of(tiny) is bank_of(tiny)


def test_two_who_prepare_in_turn_share_the_work(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(starts, "_banks", OrderedDict())
    alone = len(list(preparing(tiny)))
    monkeypatch.setattr(starts, "_banks", OrderedDict())
    turns = list(zip_longest(preparing(tiny), preparing(tiny)))
    assert len(turns) == math.ceil(alone / 2)


def test_a_model_that_shows_nothing_is_refused():
    empty = random_model()
    empty.field.density_layer.bias.fill_(-1e4)
    with pytest.raises(ValueError, match="no objects"):
        bank_of(empty)


def test_a_picture_of_one_pixel_on_the_object_still_has_starts(tiny: Model):
    mask = torch.zeros(SMALL, SMALL, dtype=torch.bool)
    mask[5, 7] = True
    starts = ranked(bank_of(tiny), tiny, torch.ones(SMALL, SMALL, 3), mask, 30.0, 6)
    assert bool(starts.distance.isfinite().all())
    assert float(starts.distance.max()) <= 2 * tiny.distance
    assert float(starts.elevation.abs().max()) < math.pi / 2


SMALL = 16
