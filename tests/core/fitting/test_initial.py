from dataclasses import replace

import pytest
import torch

from core.fitting.hypotheses import Hypothesis, HypothesisBatch, to_cameras
from core.fitting.initial import initial_hypotheses, local_hypotheses, resume_from
from core.fitting.problem import Problem
from core.fitting.schedule import LOCAL_HYPOTHESES, LOCAL_OFFSETS
from core.fitting.settings import Components, FitSettings
from core.geometry.camera import Camera
from core.models.model import Model
from core.photos.photo import Photo
from tests.conftest import random_model
from tests.core.fitting.inputs import problem_of, seeded
from tests.core.tiny import photo_of, tiny_bank

WITH_FOCAL = FitSettings(estimate_focal=True)


@pytest.fixture(scope="module")
def cameras(tiny: Model) -> list[Camera]:
    return [tiny.camera(0.9, 0.5), tiny.camera(2.9, 0.3)]


def photos_of(model: Model, cameras: list[Camera], posed: tuple[bool, ...]) -> list[Photo]:
    return [
        replace(photo_of(model[2], camera), camera=camera if is_posed else None)
        for camera, is_posed in zip(cameras, posed, strict=True)
    ]


def initial(problem: Problem, count: int) -> HypothesisBatch:
    return initial_hypotheses(problem, count, seeded())


def test_known_cameras_are_kept_with_the_mean_shape_and_prototypes(tiny: Model, cameras: list[Camera]):
    batch = initial(problem_of(tiny, *photos_of(tiny, cameras, (True, True))), 8)
    angles = torch.tensor([[camera.azimuth, camera.elevation] for camera in cameras])
    assert torch.equal(batch.parameters.angles, angles.expand(len(batch), 2, 2))
    assert len(batch) == len(batch.parameters.shape.unique(dim=0)) > 2
    assert not batch.parameters.shape[0].any()
    assert not batch.parameters.texture.any()
    problem = problem_of(tiny, *photos_of(tiny, cameras, (True, False)))
    batch = initial(problem, 8)
    angles = local_hypotheses(problem, batch, LOCAL_HYPOTHESES).parameters.angles
    assert torch.equal(angles[:, 0], batch.parameters.angles[:1, 0].expand(len(angles), 2))
    assert len(angles[:, 1].unique(dim=0)) > 2


def test_a_local_search_keeps_cameras_and_resets_codes(tiny: Model, cameras: list[Camera]):
    problem = problem_of(tiny, *photos_of(tiny, cameras[:1], (False,)))
    first = initial(problem, 8)
    moved = first.parameters._replace(shape=first.parameters.shape + 3, texture=first.parameters.texture + 3)
    batch = replace(first, parameters=moved, loss=torch.arange(8.0))
    again = local_hypotheses(problem, batch, LOCAL_HYPOTHESES)
    assert len(LOCAL_OFFSETS[0]) < len(again) <= LOCAL_HYPOTHESES
    assert float(again.parameters.shape.abs().max()) < 3
    assert not again.parameters.texture.any()
    around = (again.parameters.angles - batch.parameters.angles[again.origin]).rad2deg()[:, 0]
    moves = {move[:2] for offsets in LOCAL_OFFSETS for move in offsets}
    assert {tuple(move) for move in around.round(decimals=3).tolist()} == moves
    assert again.origin[0] == 0
    assert len(again.origin.unique()) == len(LOCAL_OFFSETS)
    places = sum(len(offsets) for offsets in LOCAL_OFFSETS)
    few = local_hypotheses(problem, batch, places)
    kept = torch.cat((few.origin[:, None], few.parameters.angles[:, 0]), 1).unique(dim=0)
    assert len(few) == len(kept) == places  # every place is kept, with fewer shapes


def test_hypotheses_are_limited_by_the_bank(tiny: Model, cameras: list[Camera]):
    unknown = problem_of(tiny, *photos_of(tiny, cameras, (True, False)), settings=WITH_FOCAL)
    few, most = (len(initial(unknown, count)) for count in (5, 1000))
    assert few == 5
    assert 20 < most < 168
    posed = problem_of(tiny, *photos_of(tiny, cameras, (True, True)))
    shapes = len(tiny_bank().prototypes)
    few, most = (len(initial(posed, count)) for count in (3, 1000))
    assert few == 3
    assert most in (shapes, shapes + 1)


def test_a_model_with_an_empty_bank_still_has_its_mean_shape():
    mist = random_model()
    mist.field.density_layer.bias.fill_(-1e4)
    camera = mist.camera(0.3, 0.3)
    photo = Photo(torch.zeros(32, 32, 3), torch.ones(32, 32, dtype=torch.bool), camera)
    batch = initial(problem_of(mist, photo), 6)
    assert len(batch) == 1
    assert not batch.parameters.shape.any()


def test_unknown_cameras_come_from_the_bank_with_alternating_focal_lengths(tiny: Model, cameras: list[Camera]):
    batch = initial(problem_of(tiny, *photos_of(tiny, cameras, (True, False))), 6)
    first, second = batch.parameters.angles.unbind(1)
    assert len(batch) == len(second.unique(dim=0)) == 6
    assert len(first.unique(dim=0)) == 1
    assert not batch.parameters.zoom.any()
    assert not batch.parameters.crop_transform.any()
    zoom = initial(problem_of(tiny, *photos_of(tiny, cameras, (True, False)), settings=WITH_FOCAL), 8).parameters.zoom
    assert not zoom[:, 0].any()
    assert torch.equal(zoom[::2, 1], zoom[1::2, 1])
    assert len(zoom[:6, 1].unique()) == 3


def test_resume_from_restores_the_hypothesis_and_keeps_known_cameras(tiny: Model, cameras: list[Camera]):
    photos = photos_of(tiny, cameras, (True, False))
    fitted = [tiny.camera(5.0, 0.1), replace(tiny.camera(2.5, 0.2, 1.3 * tiny.distance), focal=1.3 * tiny.focal)]
    spaces = tiny.codes.shape_space, tiny.codes.texture_space
    hypothesis = Hypothesis(
        3, 1.0, tuple(fitted), tiny[1], torch.tensor([[0.0, 0.0, 0.0, 0.0], [0.1, 0.02, 0.01, -0.02]])
    )
    batch = resume_from(tiny, photos, cameras, hypothesis, spaces)
    back = to_cameras(tiny, batch.parameters, 0, cameras)
    assert batch.origin.tolist() == [3]
    assert back[0].azimuth == pytest.approx(cameras[0].azimuth)  # given, whatever the earlier fit had
    assert (back[1].azimuth, back[1].distance, back[1].focal) == pytest.approx(
        (fitted[1].azimuth, fitted[1].distance, fitted[1].focal)
    )
    torch.testing.assert_close(spaces[0].code(batch.parameters.shape[0]), tiny.codes[1].shape, atol=1e-4, rtol=1e-4)


def test_disabled_components_do_not_affect_initial_hypotheses(tiny: Model, cameras: list[Camera]):
    components = Components(view_bank=False)
    batch = initial(problem_of(tiny, *photos_of(tiny, cameras[:1], (False,)), components=components), 12)
    assert len(batch.parameters.angles[:, 0].unique(dim=0)) == 12
    assert float(batch.parameters.angles[..., 1].min()) >= 0
    assert not batch.parameters.shape.any() and not batch.parameters.distance.any()
    for posed in (True, False):
        photos = photos_of(tiny, cameras[:1], (posed,))
        batch = initial(problem_of(tiny, *photos, components=Components(prototype_shapes=False)), 6)
        assert not batch.parameters.shape.any()
    problem = problem_of(tiny, *photos_of(tiny, cameras[:1], (False,)), components=Components(fresh_codes=False))
    batch = initial(problem, 8)
    assert local_hypotheses(problem, batch, 18) is batch
