import math
from dataclasses import replace

import pytest
import torch

from core.fitting.hypotheses import Objective, Pool, cameras
from core.fitting.initial import combined, entrants, gone_on, renewed
from core.fitting.schedule import AROUND, RENEWED
from core.geometry.camera import Camera
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.view_bank import bank_of
from core.rendering.reference import render_exact
from tests.conftest import random_model


@pytest.fixture(scope="module")
def given(tiny: Model) -> list[Camera]:
    return [tiny.camera(0.9, 0.5), tiny.camera(2.9, 0.3)]


def photos_of(model: Model, given: list[Camera], known: tuple[bool, ...]) -> list[Photo]:
    seen = [render_exact(model, model.codes[2], camera, 48) for camera in given]
    return [
        Photo(one.colour.clamp(0, 1), one.opacity > 0.5, camera if given_away else None)
        for one, camera, given_away in zip(seen, given, known, strict=True)
    ]


def test_known_cameras_come_with_the_mean_shape_and_several_others(tiny: Model, given: list[Camera]):
    pool = entrants(tiny, photos_of(tiny, given, (True, True)), given, 8, lens=False)
    angles = torch.tensor([[camera.azimuth, camera.elevation] for camera in given])
    assert torch.equal(pool.numbers.angles, angles.expand(len(pool), 2, 2))
    assert len(pool) == len(pool.numbers.shape.unique(dim=0)) > 2
    assert not pool.numbers.shape[0].any()
    assert not pool.numbers.texture.any()


def test_a_second_heat_keeps_cameras_and_forgets_codes(tiny: Model, given: list[Camera]):
    photos = photos_of(tiny, given[:1], (False,))
    first = entrants(tiny, photos, given[:1], 8, lens=False)
    moved = first.numbers._replace(shape=first.numbers.shape + 3, texture=first.numbers.texture + 3)
    pool = replace(first, numbers=moved, cost=torch.arange(8.0), opened=(2, 2))
    again = renewed(tiny, photos, given[:1], pool, RENEWED)
    assert len(AROUND[0]) < len(again) <= RENEWED
    assert again.opened == (0, 0)
    assert float(again.numbers.shape.abs().max()) < 3
    assert not again.numbers.texture.any()
    around = (again.numbers.angles - pool.numbers.angles[again.start]).rad2deg()[:, 0]
    assert {tuple(move) for move in around.round(decimals=3).tolist()} == {move[:2] for part in AROUND for move in part}
    assert again.start[0] == 0
    assert len(again.start.unique()) == len(AROUND)
    places = sum(len(part) for part in AROUND)
    few = renewed(tiny, photos, given[:1], pool, places)
    kept = torch.cat((few.start[:, None], few.numbers.angles[:, 0]), 1).unique(dim=0)
    assert len(few) == len(kept) == places  # every place is kept, with fewer shapes


def test_known_cameras_stay_in_a_second_heat(tiny: Model, given: list[Camera]):
    photos = photos_of(tiny, given, (True, False))
    pool = entrants(tiny, photos, given, 8, lens=False)
    angles = renewed(tiny, photos, given, pool, RENEWED).numbers.angles
    assert torch.equal(angles[:, 0], pool.numbers.angles[:1, 0].expand(len(angles), 2))
    assert len(angles[:, 1].unique(dim=0)) > 2


def test_there_are_no_more_starts_than_the_bank_has_apart(tiny: Model, given: list[Camera]):
    photos = photos_of(tiny, given, (True, False))
    few, all_there_are = (len(entrants(tiny, photos, given, count, lens=True)) for count in (5, 1000))
    assert few == 5
    assert 20 < all_there_are < 168


def test_there_are_no_more_shapes_than_the_bank_has(tiny: Model, given: list[Camera]):
    photos = photos_of(tiny, given, (True, True))
    few, all_there_are = (len(entrants(tiny, photos, given, count, lens=True).cost) for count in (3, 1000))
    assert few == 3
    assert all_there_are in (len(bank_of(tiny).codes.shape), len(bank_of(tiny).codes.shape) + 1)


def test_a_model_with_an_empty_bank_still_has_its_mean_shape():
    mist = random_model()
    mist.field.density_layer.bias.fill_(-1e4)
    camera = mist.camera(0.3, 0.3)
    photo = Photo(torch.zeros(32, 32, 3), torch.ones(32, 32, dtype=torch.bool), camera)
    pool = entrants(mist, [photo], [camera], 6, lens=False)
    assert len(pool) == 1
    assert not pool.numbers.shape.any()


def test_an_unknown_camera_comes_from_the_bank_and_a_known_one_stays(tiny: Model, given: list[Camera]):
    pool = entrants(tiny, photos_of(tiny, given, (True, False)), given, 6, lens=False)
    first, second = pool.numbers.angles.unbind(1)
    assert len(pool) == len(second.unique(dim=0)) == 6
    assert len(first.unique(dim=0)) == 1
    assert not pool.numbers.zoom.any()
    assert not pool.numbers.shift.any()


def test_unknown_cameras_take_turns_in_lenses_a_pair_at_a_time(tiny: Model, given: list[Camera]):
    zoom = entrants(tiny, photos_of(tiny, given, (True, False)), given, 8, lens=True).numbers.zoom
    assert not zoom[:, 0].any()
    assert torch.equal(zoom[::2, 1], zoom[1::2, 1])
    assert len(zoom[:6, 1].unique()) == 3


def test_one_hypothesis_goes_on_where_another_fit_ended(tiny: Model, given: list[Camera]):
    photos = photos_of(tiny, given, (True, False))
    found = [tiny.camera(5.0, 0.1), replace(tiny.camera(2.5, 0.2, 1.3 * tiny.distance), focal=1.3 * tiny.focal)]
    by, shift = Objective(1e-5), torch.tensor([[0.0, 0.0], [0.01, -0.02]])
    pool = gone_on(tiny, photos, given, found, shift, tiny.codes[1], by.spaces(tiny))
    back = cameras(tiny, pool.numbers, 0, given)
    assert back[0].azimuth == pytest.approx(given[0].azimuth)  # given, whatever the earlier fit had
    assert (back[1].azimuth, back[1].distance, back[1].focal) == pytest.approx(
        (found[1].azimuth, found[1].distance, found[1].focal)
    )
    torch.testing.assert_close(
        by.spaces(tiny)[0].code(pool.numbers.shape[0]), tiny.codes[1].shape, atol=1e-4, rtol=1e-4
    )


def test_the_cheapest_combinations_of_single_races_meet(tiny: Model, given: list[Camera]):
    pools = [entrants(tiny, photos_of(tiny, [camera], (False,)), [camera], 4, lens=False) for camera in given]
    one, two = (
        replace(pool, cost=torch.tensor(cost), opened=opened)
        for pool, cost, opened in zip(
            pools, ([0.1, 0.5, 9.0, 9.0], [0.3, math.inf, 0.2, 9.0]), ((1, 2), (2, 1)), strict=True
        )
    )
    pool: Pool = combined([([0], one), ([1], two)], 2, 3)
    chosen = [(0, 2), (0, 0), (1, 2)]
    expected = torch.stack([torch.cat((one.numbers.angles[i], two.numbers.angles[j])) for i, j in chosen])
    assert torch.equal(pool.numbers.angles, expected)
    mean = (one.numbers.shape[0] + two.numbers.shape[2]) / 2
    torch.testing.assert_close(pool.numbers.shape[0], mean)
    assert pool.opened == (2, 2)
