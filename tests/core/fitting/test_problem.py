"""The searched parameters and the objective of a fit."""

import math
from dataclasses import replace

import pytest
import torch

from core.fitting.hypotheses import to_cameras
from core.fitting.initial import initial_hypotheses
from core.fitting.objective import CAMERA_PRIOR_SCALE, MOVED_SCALE, SCALED_SCALE
from core.fitting.problem import FitJob
from core.fitting.settings import Components
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import problem_of, seeded
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit runs fits with checks


def stool(model: Model, posed: bool = False) -> Photo:
    camera = model.camera(0.9, 0.3)
    photo = photo_of(model[0], camera)
    return replace(photo, camera=camera) if posed else photo


def test_a_crop_has_its_scale_searched_instead_of_the_distance(tiny: Model):
    photo = stool(tiny)
    moved = replace(photo, cropped=True)
    scaled = replace(photo, cropped=True, scaled=True)
    problem = problem_of(tiny, photo, moved, scaled, replace(scaled, camera=tiny.camera(0.9, 0.3)))
    distance = problem.free[:, 2].tolist()
    scale = problem.free[:, 4].tolist()
    assert (distance, scale) == ([True, False, False, False], [False, True, True, False])
    prior = problem.objective(math.inf).camera_scale
    torch.testing.assert_close(prior[:, 3], torch.tensor([CAMERA_PRIOR_SCALE[3], MOVED_SCALE, SCALED_SCALE, math.inf]))
    assert prior[:, 5].isinf().tolist() == [False, True, True, True]
    expected = problem.objective(math.inf).expected_scale
    assert expected.any(1).tolist() == [False, False, True, False]


def test_a_known_focal_length_has_the_distance_searched(tiny: Model):
    photo = replace(stool(tiny), cropped=True, scaled=True, focal=2 * tiny.focal)
    problem = problem_of(tiny, photo)
    assert problem.free[0, 2:5].tolist() == [True, False, False]
    batch = initial_hypotheses(problem, 4, seeded())
    cameras = to_cameras(tiny, batch.parameters, 0, problem.cameras)
    assert cameras[0].focal == pytest.approx(2 * tiny.focal)
    assert cameras[0].distance == pytest.approx(2 * tiny.distance, rel=0.3)


def test_disabled_components_are_left_out_of_the_objective(tiny: Model):
    off = Components(camera_prior=False, mask_loss=False, viewpoint_classifier=False)
    problem = problem_of(tiny, stool(tiny), components=off)
    objective = problem.objective(0.2)
    assert not objective.camera_weight.any()
    assert objective.mask_weight == 0
    assert problem.viewpoints == (None,)


def test_six_crops_of_unknown_focal_length_tell_it(tiny: Model):
    photo = stool(tiny)
    crop = replace(photo, cropped=True, scaled=True)
    known = replace(crop, focal=2 * tiny.focal)
    for photos, tells in (((crop,) * 6, True), ((crop,) * 5, False), ((*(crop,) * 5, known, photo), False)):
        assert FitJob(photos).tells_focal == tells
